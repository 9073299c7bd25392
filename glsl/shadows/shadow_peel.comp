// Points and limits -> for every texel the nearest point within the limit that no earlier peel has
// taken, as a key (Dobrev et al. 2010, sec. 6, index peeling).
//
//   STEP 0: its depth, the key's high word
//   STEP 1: the smallest id of the points at exactly that depth, the key's low word
// Keys only rise from peel to peel, so a key greater than the texel's last has not been taken.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require

#include "point_constants.glsl"
#include "drawn_node.glsl"

layout(constant_id = 5) const uint STEP = 0u;

layout(scalar) readonly buffer Nodes { Node node[]; } nodes;
// Factors of opacity (lib/point_kind.glsl).
layout(scalar) readonly buffer Opacities { float factor[]; } opacities;
// Clip boxes of nodes with points on both sides.
layout(scalar) readonly buffer Boxes { Within cells[]; } within;
layout(scalar) readonly buffer Chunks { uint chunk[]; } chunks;
// Pages of a block, as texels of four words; and as words if texel buffers are too small.
layout(rgba32ui) readonly uniform uimageBuffer pages;
layout(scalar) readonly buffer PageWords { uvec4 four[]; } page_words;
// Point, depth bits; of the peel before, and of this one.
layout(scalar) readonly buffer Last { uvec2 key[]; } last;
layout(scalar) buffer Keys { uint word[]; } keys;

#include "project.glsl"
#include "shadow_limit.glsl"

void four(uint pixel[4], float depth[4], uint first) {
    for (uint k = 0u; k < 4u; ++k) {
        if (pixel[k] == NO_PIXEL) continue;
        uint bits = floatBitsToUint(depth[k]);
        uvec2 taken = last.key[pixel[k]];
        bool left = bits > taken.y || (bits == taken.y && first + k > taken.x);
        if (!left || depth[k] > limit_at(pixel[k])) continue;
        if (STEP == 0u) {
            atomicMin(keys.word[2u * pixel[k] + 1u], bits);
        } else if (bits == keys.word[2u * pixel[k] + 1u]) {
            atomicMin(keys.word[2u * pixel[k]], first + k);
        }
    }
}

#include "point_loop.glsl"
