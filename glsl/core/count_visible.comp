// Points -> number of points in the picture that opacity, back-face removal and clip boxes leave.
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
// Pages of a block, as texels of four words; and as words if texel buffers are too small.
layout(rgba32ui) readonly uniform uimageBuffer pages;
layout(scalar) readonly buffer PageWords { uvec4 four[]; } page_words;
// Low word, high word.
layout(scalar) buffer Tally { uint word[2]; } tally;

#include "project.glsl"

uint seen = 0u;

void four(uint pixel[4], float depth[4], uint first) {
    for (uint k = 0u; k < 4u; ++k) seen += uint(pixel[k] != NO_PIXEL);
}

// Adds the points of a chunk; a carry goes to the high word.
void count() {
    if (seen > 0u) {
        uint before = atomicAdd(tally.word[0], seen);
        if (before + seen < before) atomicAdd(tally.word[1], 1u);
    }
}

#define IS_TO_BE_WALKED(at) true
#define WALKED(at) count()
#include "point_loop.glsl"
