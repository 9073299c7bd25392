// Depth and ids of points -> keys of the nearest disc of each pixel of a strip, by 64-bit atomicMin
// of `depth bits << 32 | pixel of the point`. Among equal depths the upper left point is taken, so
// the picture does not depend on the order of execution.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#extension GL_EXT_shader_atomic_int64 : require
#extension GL_GOOGLE_include_directive : require

layout(local_size_x = 64) in;

layout(scalar) buffer Keys { uint64_t key[]; } keys;

void meet(uint pixel, float z, uint source) {
    uint bits = floatBitsToUint(z);
    // A stale key only costs an atomic.
    if (uint(keys.key[pixel] >> 32) < bits) return;
    atomicMin(keys.key[pixel], (uint64_t(bits) << 32) | uint64_t(source));
}

#include "clump.glsl"
#include "splat.glsl"
