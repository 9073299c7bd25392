// Points -> the strokes that may touch each tile of 8 x 8 pixels.
//
//   STEP 0: how many, of every tile
//   STEP 1: they themselves, tile after tile; the order within a tile is that of arrival, and nothing depends on it
// A stroke touches a tile where the box around its square's corners on the screen holds the middle of one of the tile's pixels. Points are looked for beyond the picture's edges, too: the view has a margin.
//
// A stroke is three texels of four words, as a pixel looks at it: with `off` from its centre, pixels, w = 1 + dot(turning, off), (u, v) = (dot(across, off), dot(along, off)) / w
//   centre, turning      across, along      depth; point; roots of colour and number of the brush; how opaque its point is, less than 0 where it has a second layer
// They lie in the list once for every tile, so that tiles read them one after the other.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_buffer_reference_uvec2 : require
#extension GL_GOOGLE_include_directive : require

#include "points.glsl"
#include "node.glsl"
#include "stroke.glsl"
#include "fragment.glsl"

layout(constant_id = 5) const uint STEP = 0u;
layout(constant_id = 7) const uint MODE = 0u;
// Not all points are opaque; and whether it takes their kinds to tell.
layout(constant_id = 8) const bool TRANSPARENT = false;
layout(constant_id = 9) const bool BY_KIND = false;
// lavapipe ends all loops of an invocation together after 65,535 rounds, and a stroke near the camera touches thousands of tiles.
layout(constant_id = 10) const uint SLICES_OF_CHUNK = 1u;
#define SLICES SLICES_OF_CHUNK

layout(buffer_reference, scalar, buffer_reference_align = 4) readonly buffer Plane { uint word[]; };

layout(scalar) readonly buffer Nodes { Node node[]; } nodes;
// Factors that make up a point's opacity.
layout(scalar) readonly buffer Opacities { float factor[]; } opacities;
// What lies in clip boxes, of nodes that have points on both sides.
layout(scalar) readonly buffer Boxes { Within cells[]; } within;
layout(scalar) readonly buffer Chunks { uint chunk[]; } chunks;
// The pages of one block, twice: as texels in fours, and for devices whose texel buffers are too small as a storage buffer.
layout(rgba32ui) readonly uniform uimageBuffer pages;
layout(scalar) readonly buffer PageWords { uvec4 four[]; } page_words;
layout(scalar) readonly buffer Homes { Home home[]; } homes;
layout(scalar) readonly buffer Turns { vec2 turn[]; } turns;
layout(scalar) readonly buffer Canvases { Canvas canvas[]; } canvases;
// The first tile, and the one after the last; which turn this is, and of how many, each of which takes as many of a node's points.
layout(scalar) readonly buffer Part { uint tile[]; } part;
// Of every tile the number of strokes, or where the next one goes.
layout(scalar) buffer Tallies { uint word[]; } tallies;
layout(scalar) writeonly buffer Strokes { uvec4 texel[]; } strokes;
layout(rgba32ui) readonly uniform uimageBuffer table;

#include "project.glsl"
#include "paint.glsl"
#include "kind.glsl"

// A point as it is seen: from the middle of the picture, pixels; how deep.
struct Seen {
    vec2 off;
    float depth;
};

// The point `i` of node `n`, exactly as all of its planes have it.
Seen seen_of(Home home, uint n, uint i) {
    Plane plane = Plane(home.page);
    ivec3 cells = ivec3(0);
    for (uint p = 0u; p < home.planes; ++p) cells = (cells << 10) | unpack_cells(plane.word[p * POINTS_PER_PAGE + i]);
    vec3 d = vec3(cells - nodes.node[n].nearest);
    float depth = row(nodes.node[n].row_z, d);
    float deep = PERSPECTIVE ? depth : 1.0;
    return Seen(vec2(row(nodes.node[n].row_x, d), row(nodes.node[n].row_y, d)) / vec2(deep), depth);
}

// As pixels look at it.
uvec4[3] stroke_of(Canvas canvas, Square square, Seen seen, Home home, uint n, uint i, uint facing, uint brush) {
    Plane plane = Plane(home.page);
    uint shown = MODE == CONSTANT ? 0u : plane.word[home.planes * POINTS_PER_PAGE + i];
    uint kind = BY_KIND ? plane.word[(home.planes + canvas.kind) * POINTS_PER_PAGE + i] : 0u;
    float opacity = TRANSPARENT ? opacity_of(kind) : 1.0;
    float deep = PERSPECTIVE ? seen.depth : 1.0;

    // In view space, for pixels at a depth of one.
    vec3 to_pixels = vec3(vec2(1.0 / (canvas.focal * canvas.focal)), 1.0);
    vec3 normal = to_view(canvas, square.normal) * to_pixels;
    vec3 t = to_view(canvas, square.tangent) * to_pixels;
    vec3 b = to_view(canvas, square.bitangent) * to_pixels;
    vec3 ray = PERSPECTIVE ? vec3(seen.off, 1.0) : vec3(0.0, 0.0, 1.0);
    // Seen from its edge it is nowhere, but has no infinity.
    float m = min(dot_of(normal, ray), -1e-5);
    vec2 sides = vec2(0.5 * deep) / square.half_side;
    vec2 turning = normal.xy / vec2(m);
    vec2 across = (t.xy - turning * vec2(dot_of(t, ray))) * vec2(sides.x);
    vec2 along = (b.xy - turning * vec2(dot_of(b, ray))) * vec2(sides.y);
    vec3 roots = sqrt(max(painted(shown, canvas.lo, canvas.ramp).rgb, vec3(0.0)));
    float layered = (brush & SMALL_CLUSTER) == 0u ? opacity : -opacity;
    uvec4 rest = uvec4(floatBitsToUint(seen.depth), nodes.node[n].first_point + i, pack_roots(roots) | facing & 0xFF000000u, floatBitsToUint(layered));
    return uvec4[3](floatBitsToUint(vec4(seen.off + canvas.middle, turning)), floatBitsToUint(vec4(across, along)), rest);
}

// What roundings may move the edge of a stroke by, pixels.
const float ROUNDING = 0.0625;

void touch(Home home, uint n, uint i, uint facing, uint brush) {
    Canvas canvas = canvases.canvas[0];
    Seen seen = seen_of(home, n, i);
    float deep = PERSPECTIVE ? seen.depth : 1.0;
    vec3 sight = PERSPECTIVE ? sight_of(canvas, seen.off) : canvas.forward;
    Square square = square_of(canvas, facing, brush, sight, canvas.focal / deep, turns.turn[turn_of(brush)]);
    vec2 reach = canvas.reach * square.half_side * vec2(2.0);
    vec3 t = to_view(canvas, square.tangent) * vec3(reach.x);
    vec3 b = to_view(canvas, square.bitangent) * vec3(reach.y);
    vec2 lo = seen.off;
    vec2 hi = seen.off;
    for (uint corner = 0u; corner < 4u; ++corner) {
        vec3 aside = ((corner & 1u) == 0u ? t : -t) + ((corner & 2u) == 0u ? b : -b);
        // What reaches behind the camera is far aside.
        float z = PERSPECTIVE ? max(deep + aside.z, 0.02 * deep) : 1.0;
        vec2 there = (seen.off * vec2(deep) + aside.xy) / vec2(z);
        lo = min(lo, there);
        hi = max(hi, there);
    }
    // It shows where the middle of a pixel lies in it.
    vec2 to_middles = canvas.middle - canvas.corner - vec2(0.5);
    ivec2 first = ivec2(floor(max(ceil(lo + to_middles - vec2(ROUNDING)) / vec2(8.0), vec2(0.0))));
    ivec2 last = ivec2(floor(min(floor(hi + to_middles + vec2(ROUNDING)) / vec2(8.0), vec2(canvas.tiles) - vec2(1.0))));
    uvec4 stroke[3] = uvec4[3](uvec4(0u), uvec4(0u), uvec4(0u));
    if (STEP == 1u) stroke = stroke_of(canvas, square, seen, home, n, i, facing, brush);
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

void four(uint pixel[4], float depth[4], uint first) {
    uint chunk = chunks.chunk[push.first_chunk + gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x];
    Home home = homes.home[first >> POINTS_PER_PAGE_LOG2];
    uint i = first & (POINTS_PER_PAGE - 1u);
    uint page = (home.planes + canvases.canvas[0].word) * POINTS_PER_PAGE + i;
    for (uint k = 0u; k < 4u; ++k) {
        uint facing = Plane(home.page).word[page + k];
        uint brush = Plane(home.page).word[page + POINTS_PER_PAGE + k];
        if (pixel[k] != NO_PIXEL && (i + k) % part.tile[3] == part.tile[2]) touch(home, chunk / CHUNKS_PER_PAGE, i + k, facing, brush);
    }
}

#include "walk.glsl"
