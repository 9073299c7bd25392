// Points and limits -> visibility: every point no deeper than its texel's limit is lit by this
// sample of the light (Dobrev et al. 2010, sec. 6, depth test).
//
// The visibility is a byte, the number of samples that light a point. A word holds four neighbours,
// and one lane writes it.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require

#include "point_constants.glsl"
#include "drawn_node.glsl"

layout(scalar) readonly buffer Nodes { Node node[]; } nodes;
// Factors of opacity (lib/point_kind.glsl).
layout(scalar) readonly buffer Opacities { float factor[]; } opacities;
// Clip boxes of nodes with points on both sides.
layout(scalar) readonly buffer Boxes { Within cells[]; } within;
layout(scalar) readonly buffer Chunks { uint chunk[]; } chunks;
// True if each listed chunk has a point near the front.
layout(scalar) readonly buffer Shallow { uint chunk[]; } shallow;
// Pages of a block, as texels of four words; and as words if texel buffers are too small.
layout(rgba32ui) readonly uniform uimageBuffer pages;
layout(scalar) readonly buffer PageWords { uvec4 four[]; } page_words;
layout(scalar) buffer LightVisibility { uint word[]; } light_visibility;

#include "project.glsl"
#include "shadow_limit.glsl"

void four(uint pixel[4], float depth[4], uint first) {
    uint lit = 0u;
    for (uint k = 0u; k < 4u; ++k) {
        bool inside = pixel[k] != NO_PIXEL;
        float reach = limit_at(inside ? pixel[k] : 0u);
        lit |= uint(inside && depth[k] <= reach) << (8u * k);
    }
    light_visibility.word[first / 4u] += lit;
}

#define IS_TO_BE_WALKED(at) (shallow.chunk[at] != 0u)
#define WALKED(at)
#include "point_loop.glsl"
