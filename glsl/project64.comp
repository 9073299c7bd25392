// Points -> keys, by 64-bit atomicMin of `depth bits << 32 | point`.
//
// Positive floats order like their bits, so the least key is the nearest point, and of equally near ones the least id:
// the result does not depend on the order of execution (papers/README.md, conventions).
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#extension GL_EXT_shader_atomic_int64 : require
#extension GL_GOOGLE_include_directive : require

#define MORE_TO_PUSH uint layer; float epsilon;
#include "points.glsl"
#include "node.glsl"

layout(scalar) readonly buffer Nodes { Node node[]; } nodes;
// Factors that make up a point's opacity.
layout(scalar) readonly buffer Opacities { float factor[]; } opacities;
// What lies in clip boxes, of nodes that have points on both sides.
layout(scalar) readonly buffer Boxes { Within cells[]; } within;
layout(scalar) readonly buffer Chunks { uint chunk[]; } chunks;
// The pages of one block, twice: as texels in fours, and for devices whose texel buffers are too small as a storage buffer.
layout(rgba32ui) readonly uniform uimageBuffer pages;
layout(scalar) readonly buffer PageWords { uvec4 four[]; } page_words;
// The words of `keys` as texels.
layout(r32ui) readonly uniform uimageBuffer front;
// Of every pixel, the bits of the depth behind which points are looked for; as texels, and as words.
layout(r32ui) readonly uniform uimageBuffer behind;
layout(scalar) readonly buffer BehindWords { uint word[]; } behind_words;
// Of every listed chunk, the last layer that it had points behind the ones before of.
layout(scalar) buffer Alive { uint layer[]; } alive;
// Of every listed chunk, whether it has a point near the front.
layout(scalar) buffer Shallow { uint chunk[]; } shallow;
layout(scalar) buffer Keys { uint64_t key[]; } keys;

#include "project.glsl"

// Of the nearest point so far; may be stale.
uint front_depth(uint pixel) {
    return TEXELS ? imageLoad(front, int(2u * pixel + 1u)).r : uint(keys.key[pixel] >> 32);
}

uint depth_behind(uint pixel) {
    return TEXELS ? imageLoad(behind, int(pixel)).r : behind_words.word[pixel];
}

void meet(uint pixel, float depth, uint point) {
    atomicMin(keys.key[pixel], (uint64_t(floatBitsToUint(depth)) << 32) | uint64_t(point));
}

#include "nearest.glsl"
#include "walk.glsl"
