// Points -> strokes on the screen, each at the place of its point, so that they are in the order of
// their numbers.
//
// A stroke is four texels of four words. First: half sides of the parallelogram around what its
// brush covers [px], 0 if it is outside of the picture. Then, if it is inside:
//   centre, turning      across, along (stroke_walk.glsl)
//   depth; point; number of the brush in the last byte; square of the reach of its near ground as
//   a share of a side, negative if it has a second layer
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_buffer_reference_uvec2 : require
#extension GL_GOOGLE_include_directive : require

// First place and end.
layout(scalar) readonly buffer Part { uint place[]; } part;
layout(scalar) writeonly buffer Strokes { uvec4 texel[]; } strokes;

#include "stroke_walk.glsl"

// Bound on the rounding error of a stroke's edge, including the rasteriser's [px].
const float ROUNDING = 0.0625;
// Sine of the angle between the sides of the narrowest parallelogram that is not replaced by a box.
const float NARROW = 0.05;

// Returns how far a parallelogram's sides stand out if its true corners do by `by`.
vec4 grown(vec2 a, vec2 b, float by, float area) {
    return vec4(a * vec2(1.0 + by * length(b) / area), b * vec2(1.0 + by * length(a) / area));
}

float area_of(vec4 sides) {
    return abs(sides.x * sides.w - sides.y * sides.z);
}

bool has_room(Stroked point, out uint place) {
    place = point.home.first_place + point.i;
    bool has = place >= part.place[0] && place < part.place[1];
    place -= part.place[0];
    return has;
}

float near_ground(Canvas canvas, Square square, Seen seen) {
    float deep = PERSPECTIVE ? seen.depth : 1.0;
    float side_px = 2.0 * square.half_side.y * canvas.focal / deep;
    float beyond = min(canvas.nearer * max(canvas.ground * side_px - 1.0, 0.0), canvas.nearer_px);
    return canvas.ground - beyond / side_px;
}

void miss(Stroked point) {
    uint place;
    if (has_room(point, place)) strokes.texel[4u * place] = uvec4(0u);
}

void touch(Stroked point) {
    uint place;
    if (!has_room(point, place)) return;
    Canvas canvas = canvases.canvas[0];
    Seen seen = seen_of(point);
    Square square = seen_square(canvas, seen, point);
    bool is_before;
    vec2 corners[4] = corners_of(canvas, square, seen, is_before);
    vec2 lo = min(min(corners[0], corners[1]), min(corners[2], corners[3]));
    vec2 hi = max(max(corners[0], corners[1]), max(corners[2], corners[3]));
    // Around its point, like everything that is drawn.
    vec2 box = max(hi - seen.off, seen.off - lo) + vec2(ROUNDING);
    vec2 a = (corners[1] + corners[3] - corners[0] - corners[2]) * vec2(0.25);
    vec2 b = (corners[2] + corners[3] - corners[0] - corners[1]) * vec2(0.25);
    float out_of_it = 0.0;
    for (uint corner = 0u; corner < 4u; ++corner) {
        vec2 affine = seen.off + ((corner & 1u) == 0u ? -a : a) + ((corner & 2u) == 0u ? -b : b);
        out_of_it = max(out_of_it, length(corners[corner] - affine));
    }
    float area = abs(a.x * b.y - a.y * b.x);
    vec4 sides = vec4(box.x, 0.0, 0.0, box.y);
    if (is_before && area > NARROW * length(a) * length(b)) {
        vec4 narrower = grown(a, b, out_of_it + ROUNDING, area);
        sides = area_of(narrower) < area_of(sides) ? narrower : sides;
    }
    vec2 to_picture = canvas.middle - canvas.corner;
    bool shows = all(greaterThan(seen.off + to_picture + box, vec2(0.0))) && all(lessThan(seen.off + to_picture - box, vec2(canvas.size)));
    uvec4 lies[2] = lying(canvas, square, seen);
    strokes.texel[4u * place] = shows ? floatBitsToUint(sides) : uvec4(0u);
    strokes.texel[4u * place + 1u] = lies[0];
    strokes.texel[4u * place + 2u] = lies[1];
    float near = near_ground(canvas, square, seen);
    float layered = (point.brush & SMALL_CLUSTER) == 0u ? near * near : -near * near;
    strokes.texel[4u * place + 3u] = uvec4(floatBitsToUint(seen.depth), nodes.node[point.n].first_point + point.i, point.facing & 0xFF000000u, floatBitsToUint(layered));
}
