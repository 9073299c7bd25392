// Points -> keys, by 64-bit atomicMin of `depth bits << 32 | point`.
//
// Positive floats order like their bits, so the least key is the nearest point, and of equally near ones the least id:
// the result does not depend on the order of execution (papers/README.md, conventions).
//
// One workgroup walks POINTS_PER_CHUNK points of one node in LANES lanes; the dispatch is exact, since a padded one costs 20 to 50 % (PROBE.md).
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_samplerless_texture_functions : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#extension GL_EXT_shader_atomic_int64 : require
#extension GL_GOOGLE_include_directive : require

#include "points.glsl"
#include "node.glsl"

layout(scalar) readonly buffer Nodes { Node node[]; } nodes;
layout(scalar) readonly buffer Chunks { uint chunk[]; } chunks;
uniform utextureBuffer pages;
layout(scalar) buffer Keys { uint64_t key[]; } keys;

#include "project.glsl"

void meet(uint pixel, float depth, uint point) {
    uint64_t key = (uint64_t(floatBitsToUint(depth)) << 32) | uint64_t(point);
    if (!EARLY_READ || key < keys.key[pixel]) atomicMin(keys.key[pixel], key);
}

#include "walk.glsl"
