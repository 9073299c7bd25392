// Fragments of a pixel -> a few more of them sorted, and the blended colour of the sorted ones, the
// nearest over those behind (dos Anjos et al. 2018, sec. 3.3.3).
//
//   blend the sorted ones
//   bring the nearest of the others behind them and blend it; repeat as often as wanted
//     BUBBLE     from the farthest place forwards, the nearer of two neighbours moves on (algorithm 2)
//     otherwise  it is searched for and swapped with the first of them
// After n - 1 times n fragments are sorted; a pixel is done earlier if the remaining light can
// change nothing. Sorting continues from frame to frame and from pass to pass: lavapipe ends all
// loops of an invocation after 65,535 rounds. Keys are integers: depth with a brush in its lowest
// bits, then the remaining light, then colour. So equally near fragments have an order, too, and
// there is no NaN (guide: numerics, case 16).
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require

#include "stroke_fragment.glsl"
#include "stroke_constants.glsl"
#include "pixel_index.glsl"

layout(local_size_x = 64) in;

layout(constant_id = 0) const bool BUBBLE = false;

layout(scalar) readonly buffer Canvases { Canvas canvas[]; } canvases;
// First tile and end.
layout(scalar) readonly buffer Part { uint tile[]; } part;
// First fragment of every pixel, tile by tile, and the end of all.
layout(scalar) readonly buffer Starts { uint word[]; } starts;
layout(scalar) buffer Fragments { uvec2 fragment[]; } fragments;
// Colour times coverage, and coverage.
layout(rgba32f) writeonly uniform image2D color;
// Not 0 if sorting more of them would change a pixel.
layout(scalar) buffer Unordered { uint word[]; } unordered;

layout(push_constant, scalar) uniform Push {
    uint top;     // first row of the strip in the picture
    uint ordered; // sorted fragments of each pixel before
    uint wanted;  // and after
} push;

void main() {
    Canvas canvas = canvases.canvas[0];
    uint place = gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x;
    uint tile = part.tile[0] + place;
    if (tile >= part.tile[1]) return;
    uint lane = gl_LocalInvocationID.x;
    uvec2 pixel = uvec2(in_rows(tile, canvas.tiles.x)) * 8u + uvec2(lane % 8u, lane / 8u);
    if (pixel.x >= canvas.size.x || pixel.y >= canvas.size.y) return;
    uint start = starts.word[place * 64u + lane];
    uint end = starts.word[place * 64u + lane + 1u];
    vec4 sum = vec4(0.0);
    uint next = start;
    uint ordered = start + min(push.ordered, end - start);
    for (; next < ordered && shows(sum); ++next) sum = over(sum, fragments.fragment[next].x);
    uint wanted = start + min(push.wanted, end - start);
    for (; next < wanted && shows(sum); ++next) {
        uvec2 nearest = fragments.fragment[BUBBLE ? end - 1u : next];
        if (BUBBLE) {
            for (uint k = end - 1u; k > next; --k) {
                uvec2 ahead = fragments.fragment[k - 1u];
                bool swap = before(nearest, ahead);
                fragments.fragment[k] = swap ? ahead : nearest;
                nearest = swap ? nearest : ahead;
            }
        } else {
            uvec2 first = nearest;
            uint found = next;
            for (uint k = next + 1u; k < end; ++k) {
                uvec2 other = fragments.fragment[k];
                bool swap = before(other, nearest);
                nearest = swap ? other : nearest;
                found = swap ? k : found;
            }
            fragments.fragment[found] = first;
        }
        fragments.fragment[next] = nearest;
        sum = over(sum, nearest.x);
    }
    imageStore(color, ivec2(pixel.x, pixel.y + push.top), sum);
    // One write is enough: an atomic per pixel would dominate this pass.
    if (next < end && shows(sum) && unordered.word[0] == 0u) atomicOr(unordered.word[0], 1u);
}
