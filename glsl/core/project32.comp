// Points -> keys on devices without 64-bit atomics: two passes of 32-bit atomicMin on the two words
// of the same key.
//
//   STEP 0: smallest depth of each pixel -> its high word
//   STEP 1: smallest id of the points at exactly that depth -> its low word
// Both steps compute depths by the same function from the same words, so the front point always
// matches its own depth (guide: numerics, case 25).
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require

#define MORE_TO_PUSH uint layer; float epsilon;
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
// Words of `keys` as texels; and in fours, which are the keys of a layer behind others.
layout(r32ui) readonly uniform uimageBuffer front;
layout(rgba32ui) readonly uniform uimageBuffer front_behind;
// Last layer that each listed chunk had points behind the ones before.
layout(scalar) buffer Alive { uint layer[]; } alive;
// True if each listed chunk has a point near the front.
layout(scalar) buffer Shallow { uint chunk[]; } shallow;
layout(scalar) buffer Keys { uint word[]; } keys;

// True if this is a layer behind others: only deeper points count (Dobrev et al. 2010, sec. 4).
layout(constant_id = 7) const bool BEHIND = false;

#include "keys.glsl"
#include "project.glsl"

// Returns the depth of the nearest point so far, which may be stale, and the depth of the layers
// before, if any.
uint front_depth(uint pixel, inout uint least) {
    if (!BEHIND) return TEXELS ? imageLoad(front, int(depth_word(pixel))).r : keys.word[depth_word(pixel)];
    uvec4 both = TEXELS ? imageLoad(front_behind, int(pixel)) : uvec4(keys.word[4u * pixel], 0u, 0u, keys.word[depth_word(pixel)]);
    least = both.x;
    return both.w;
}

void meet(uint pixel, float depth, uint point) {
    if (STEP == 0u) {
        atomicMin(keys.word[depth_word(pixel)], floatBitsToUint(depth));
    } else if (floatBitsToUint(depth) == keys.word[depth_word(pixel)]) {
        atomicMin(keys.word[point_word(pixel)], point);
    }
}

#include "nearest_key.glsl"
#include "point_loop.glsl"
