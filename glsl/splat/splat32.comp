// The same as splat64.comp on devices without 64-bit atomics, in two steps on the words of a key:
//
//   STEP 0: smallest depth of each pixel -> its high word
//   STEP 1: first pixel of the points at exactly that depth -> its low word
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require

layout(local_size_x = 64) in;

layout(constant_id = 1) const uint STEP = 0u;

layout(scalar) buffer Keys { uint word[]; } keys;

void meet(uint pixel, float z, uint source) {
    uint bits = floatBitsToUint(z);
    if (STEP == 0u) {
        atomicMin(keys.word[2u * pixel + 1u], bits);
    } else if (bits == keys.word[2u * pixel + 1u]) {
        atomicMin(keys.word[2u * pixel], source);
    }
}

#include "clump.glsl"
#include "splat.glsl"
