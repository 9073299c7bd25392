// Fragments of a pixel -> a few more of them in order, and the colour that those in order give, the nearest over those behind it (dos Anjos et al. 2018, sec. 3.3.3).
//
//   those in order, each over the next
//   the nearest of the others is brought behind them, and they are laid over it; as often as is wanted
//     BUBBLE     from the farthest place forwards the nearer of two neighbours moves on (algorithm 2)
//     otherwise  it is looked for, and changes places with the first of them
// After n - 1 times n fragments are in order; a pixel is done before, where what is left of the light can change nothing. It goes on from frame to frame, and from pass to pass: lavapipe ends all loops
// of an invocation together after 65,535 rounds. Keys are integers: depth with a brush in its lowest bits, then what is left of the light, then colour, so that equally near fragments have an order, too, and no NaN stands in the way (HARD_CASES 16).
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require

#include "stroke_fragment.glsl"
#include "stroke_constants.glsl"
#include "pixel_index.glsl"

layout(local_size_x = 64) in;

layout(constant_id = 0) const bool BUBBLE = false;

layout(scalar) readonly buffer Canvases { Canvas canvas[]; } canvases;
// The first tile, and the one after the last.
layout(scalar) readonly buffer Part { uint tile[]; } part;
// Of every pixel, tile by tile, the first fragment; and the one after the last of all.
layout(scalar) readonly buffer Starts { uint word[]; } starts;
layout(scalar) buffer Fragments { uvec2 fragment[]; } fragments;
// Colour times coverage, and coverage.
layout(rgba32f) writeonly uniform image2D color;
// Not 0 where more of them in order would change a pixel.
layout(scalar) buffer Unordered { uint word[]; } unordered;

layout(push_constant, scalar) uniform Push {
    uint top;     // first row of the band in the picture
    uint ordered; // fragments of each pixel that are in order
    uint wanted;  // and that shall be
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
    // One is enough: an atomic for every pixel would be most of this pass.
    if (next < end && shows(sum) && unordered.word[0] == 0u) atomicOr(unordered.word[0], 1u);
}
