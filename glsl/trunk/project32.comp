// Points -> keys where a device has no 64-bit atomics: two passes of 32-bit atomicMin on the two words of the same key.
//
//   STEP 0: the least depth of each pixel, into its high word
//   STEP 1: of the points at exactly that depth, the least id, into its low word
// Depths are recomputed by the same function from the same words, so the front point always meets its own depth (HARD_CASES 25).
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require

#define MORE_TO_PUSH uint layer; float epsilon;
#include "point_constants.glsl"
#include "drawn_node.glsl"

layout(constant_id = 5) const uint STEP = 0u;

layout(scalar) readonly buffer Nodes { Node node[]; } nodes;
// Factors that make up a point's opacity.
layout(scalar) readonly buffer Opacities { float factor[]; } opacities;
// What lies in clip boxes, of nodes that have points on both sides.
layout(scalar) readonly buffer Boxes { Within cells[]; } within;
layout(scalar) readonly buffer Chunks { uint chunk[]; } chunks;
// The pages of one block, twice: as texels in fours, and for devices whose texel buffers are too small as a storage buffer.
layout(rgba32ui) readonly uniform uimageBuffer pages;
layout(scalar) readonly buffer PageWords { uvec4 four[]; } page_words;
// The words of `keys` as texels; and in fours, which are the keys of a layer behind others.
layout(r32ui) readonly uniform uimageBuffer front;
layout(rgba32ui) readonly uniform uimageBuffer front_behind;
// Of every listed chunk, the last layer that it had points behind the ones before of.
layout(scalar) buffer Alive { uint layer[]; } alive;
// Of every listed chunk, whether it has a point near the front.
layout(scalar) buffer Shallow { uint chunk[]; } shallow;
layout(scalar) buffer Keys { uint word[]; } keys;

// A layer behind others: only what lies deeper than they do (Dobrev et al. 2010, sec. 4).
layout(constant_id = 7) const bool BEHIND = false;

#include "keys.glsl"
#include "project.glsl"

// Of the nearest point so far, which may be stale; and how deep the layers before are, where there are any.
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
