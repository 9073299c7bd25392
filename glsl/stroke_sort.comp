// One pass of a bubble sort over the fragments of every pixel (dos Anjos et al. 2018, algorithm 2).
//
// From the farthest place forwards the nearer of two neighbours moves on, until the nearest of those that are not yet in order is in its place, `pass`. After n - 1 passes n fragments are in order. Keys are
// integers: depth, then colour and coverage, so that equally near fragments have an order, too, and no NaN stands in the way (HARD_CASES 16).
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require

#include "fragment.glsl"

layout(local_size_x = 64) in;

// The first tile, and the one after the last.
layout(scalar) readonly buffer Part { uint tile[]; } part;
// Of every pixel, tile by tile, the first fragment; and the one after the last of all.
layout(scalar) readonly buffer Starts { uint word[]; } starts;
layout(scalar) buffer Fragments { uvec2 fragment[]; } fragments;

layout(push_constant, scalar) uniform Push {
    uint pass_; // from 0
} push;

void main() {
    uint place = gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x;
    if (part.tile[0] + place >= part.tile[1]) return;
    uint pixel = place * 64u + gl_LocalInvocationID.x;
    uint first = starts.word[pixel] + push.pass_;
    uint end = starts.word[pixel + 1u];
    if (first >= end) return;
    uvec2 moving = fragments.fragment[end - 1u];
    for (uint k = end - 1u; k > first; --k) {
        uvec2 next = fragments.fragment[k - 1u];
        bool swap = before(moving, next);
        fragments.fragment[k] = swap ? next : moving;
        moving = swap ? moving : next;
    }
    fragments.fragment[first] = moving;
}
