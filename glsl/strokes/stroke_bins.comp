// Points -> strokes that may touch each tile of 8 x 8 pixels.
//
//   STEP 0: their number for every tile
//   STEP 1: the strokes, tile after tile; their order within a tile is that of arrival and irrelevant
// A stroke touches a tile if the box around its square's corners on the screen holds the centre of
// one of the tile's pixels. The view has a margin, since strokes of points beyond the picture reach
// into it.
//
// A stroke is three texels of four words:
//   centre, turning      across, along (stroke_walk.glsl)
//   depth; point; roots of colour, and number of the brush; opacity of its point, negative if it has
//   a second layer
// It is in the list once for every tile, so that tiles read consecutive words.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_buffer_reference_uvec2 : require
#extension GL_GOOGLE_include_directive : require

#include "stroke_fragment.glsl"

layout(constant_id = 5) const uint STEP = 0u;
layout(constant_id = 7) const uint MODE = 0u;
// True if some points are transparent.
layout(constant_id = 8) const bool TRANSPARENT = false;

// First tile and end; number of this turn and of all turns, which share a node's points.
layout(scalar) readonly buffer Part { uint tile[]; } part;
// Number of strokes of every tile, or where the next one goes.
layout(scalar) buffer Tallies { uint word[]; } tallies;
layout(scalar) writeonly buffer Strokes { uvec4 texel[]; } strokes;
layout(rgba32ui) readonly uniform uimageBuffer table;

#include "color_lookup.glsl"
#include "stroke_walk.glsl"

uvec4 rest_of(Canvas canvas, Seen seen, Stroked point) {
    Plane plane = Plane(point.home.page);
    uint shown = MODE == CONSTANT ? 0u : plane.word[point.home.planes * POINTS_PER_PAGE + point.i];
    uint kind = BY_KIND ? plane.word[(point.home.planes + canvas.kind) * POINTS_PER_PAGE + point.i] : 0u;
    float opacity = TRANSPARENT ? opacity_of(kind) : 1.0;
    vec3 roots = sqrt(max(painted(shown, canvas.lo, canvas.ramp).rgb, vec3(0.0)));
    float layered = (point.brush & SMALL_CLUSTER) == 0u ? opacity : -opacity;
    return uvec4(floatBitsToUint(seen.depth), nodes.node[point.n].first_point + point.i, pack_roots(roots) | point.facing & 0xFF000000u, floatBitsToUint(layered));
}

// Bound on the rounding error of a stroke's edge [px].
const float ROUNDING = 0.0625;

void miss(Stroked point) {}

void touch(Stroked point) {
    if (point.i % part.tile[3] != part.tile[2]) return;
    Canvas canvas = canvases.canvas[0];
    Seen seen = seen_of(point);
    Square square = seen_square(canvas, seen, point);
    bool is_before;
    vec2 corners[4] = corners_of(canvas, square, seen, is_before);
    vec2 lo = min(seen.off, min(min(corners[0], corners[1]), min(corners[2], corners[3])));
    vec2 hi = max(seen.off, max(max(corners[0], corners[1]), max(corners[2], corners[3])));
    // A stroke shows if the centre of a pixel lies in it.
    vec2 to_middles = canvas.middle - canvas.corner - vec2(0.5);
    ivec2 first = ivec2(floor(max(ceil(lo + to_middles - vec2(ROUNDING)) / vec2(8.0), vec2(0.0))));
    ivec2 last = ivec2(floor(min(floor(hi + to_middles + vec2(ROUNDING)) / vec2(8.0), vec2(canvas.tiles) - vec2(1.0))));
    uvec4 stroke[3] = uvec4[3](uvec4(0u), uvec4(0u), uvec4(0u));
    if (STEP == 1u) {
        uvec4 lies[2] = lying(canvas, square, seen);
        stroke = uvec4[3](lies[0], lies[1], rest_of(canvas, seen, point));
    }
    for (int y = first.y; y <= last.y; ++y) {
        for (int x = first.x; x <= last.x; ++x) {
            uint tile = uint(y) * canvas.tiles.x + uint(x);
            if (tile >= part.tile[0] && tile < part.tile[1]) {
                uint place = atomicAdd(tallies.word[tile - part.tile[0]], 1u);
                if (STEP == 1u) {
                    for (uint t = 0u; t < 3u; ++t) strokes.texel[3u * place + t] = stroke[t];
                }
            }
        }
    }
}
