// Points -> keys, by 64-bit atomicMin of `depth bits << 32 | point`.
//
// Positive floats order like their bits, so the least key is the nearest point, and of equally near ones the least id:
// the result does not depend on the order of execution (papers/README.md, conventions).
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#extension GL_EXT_shader_atomic_int64 : require
#extension GL_GOOGLE_include_directive : require

#include "points.glsl"
#include "node.glsl"

layout(scalar) readonly buffer Nodes { Node node[]; } nodes;
layout(scalar) readonly buffer Chunks { uint chunk[]; } chunks;
layout(rgba32ui) readonly uniform uimageBuffer pages;
// The words of `keys`.
layout(r32ui) readonly uniform uimageBuffer front;
layout(scalar) buffer Keys { uint64_t key[]; } keys;

#include "project.glsl"

void meet(uint pixel, float depth, uint point) {
    atomicMin(keys.key[pixel], (uint64_t(floatBitsToUint(depth)) << 32) | uint64_t(point));
}

#include "walk.glsl"
