// Points -> keys, by 64-bit atomicMin of `depth bits << 32 | point`.
//
// Positive floats order like their bits, so the smallest key is the nearest point, and among
// equally near ones the smallest id. The result does not depend on the order of execution (guide:
// papers).
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#extension GL_EXT_shader_atomic_int64 : require
#extension GL_GOOGLE_include_directive : require

#define MORE_TO_PUSH uint layer; float epsilon;
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
// Words of `keys` as texels; and in fours, which are the keys of a layer behind others.
layout(r32ui) readonly uniform uimageBuffer front;
layout(rgba32ui) readonly uniform uimageBuffer front_behind;
// Last layer that each listed chunk had points behind the ones before.
layout(scalar) buffer Alive { uint layer[]; } alive;
// True if each listed chunk has a point near the front.
layout(scalar) buffer Shallow { uint chunk[]; } shallow;
layout(scalar) buffer Keys { uint64_t key[]; } keys;

// True if this is a layer behind others: only deeper points count (Dobrev et al. 2010, sec. 4).
layout(constant_id = 7) const bool BEHIND = false;

#include "keys.glsl"
#include "project.glsl"

// Returns the depth of the nearest point so far, which may be stale, and the depth of the layers
// before, if any.
uint front_depth(uint pixel, inout uint least) {
    if (!BEHIND) return TEXELS ? imageLoad(front, int(depth_word(pixel))).r : uint(keys.key[pixel] >> 32);
    uvec4 both = TEXELS ? imageLoad(front_behind, int(pixel)) : uvec4(keys.key[2u * pixel], 0u, 0u, keys.key[2u * pixel + 1u] >> 32);
    least = both.x;
    return both.w;
}

void meet(uint pixel, float depth, uint point) {
    atomicMin(keys.key[point_word(pixel) / 2u], (uint64_t(floatBitsToUint(depth)) << 32) | uint64_t(point));
}

#include "nearest_key.glsl"
#include "point_loop.glsl"
