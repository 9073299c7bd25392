// Fragments of a pixel -> its colour: the nearest over those behind it.
//
// The nearest that has not been blended is looked for, until there is none, or what is left of the light can change nothing.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require

#include "fragment.glsl"
#include "canvas.glsl"

layout(local_size_x = 64) in;

layout(scalar) readonly buffer Canvases { Canvas canvas[]; } canvases;
// The first tile, and the one after the last.
layout(scalar) readonly buffer Part { uint tile[]; } part;
// Of every pixel, tile by tile, the first fragment; and the one after the last of all.
layout(scalar) readonly buffer Starts { uint word[]; } starts;
layout(scalar) readonly buffer Fragments { uvec2 fragment[]; } fragments;
// Colour times coverage, and coverage.
layout(rgba32f) writeonly uniform image2D color;

layout(push_constant, scalar) uniform Push {
    uint top; // first row of the band in the picture
} push;

void main() {
    Canvas canvas = canvases.canvas[0];
    uint place = gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x;
    uint tile = part.tile[0] + place;
    if (tile >= part.tile[1]) return;
    uint lane = gl_LocalInvocationID.x;
    uvec2 pixel = uvec2(tile % canvas.tiles.x, tile / canvas.tiles.x) * 8u + uvec2(lane % 8u, lane / 8u);
    if (pixel.x >= canvas.size.x || pixel.y >= canvas.size.y) return;
    uint start = starts.word[place * 64u + lane];
    uint end = starts.word[place * 64u + lane + 1u];
    vec4 sum = vec4(0.0);
    uvec2 last = uvec2(0u);
    uint left = end - start;
    while (left > 0u && shows(sum)) {
        uvec2 next = uvec2(0xFFFFFFFFu);
        // How often it is there: strokes may coincide.
        uint times = 0u;
        for (uint k = start; k < end; ++k) {
            uvec2 own = fragments.fragment[k];
            bool later = before(last, own);
            bool nearer = later && before(own, next);
            times = nearer ? 1u : times + (later && own == next ? 1u : 0u);
            next = nearer ? own : next;
        }
        for (uint k = 0u; k < times && shows(sum); ++k) sum = over(sum, next.x);
        last = next;
        left -= times;
    }
    imageStore(color, ivec2(pixel.x, pixel.y + push.top), sum);
}
