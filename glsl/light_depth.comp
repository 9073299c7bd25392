// Keys of the light's picture -> its depths; infinite where no point is.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require

#include "pixel.glsl"

layout(local_size_x = 64) in;

// Point, depth bits.
layout(scalar) readonly buffer Keys { uvec2 key[]; } keys;
layout(r32f) writeonly uniform image2D depth;

layout(push_constant, scalar) uniform Push {
    uvec2 size; // texels
} push;

void main() {
    uvec2 at = gl_GlobalInvocationID.xy;
    if (at.x >= push.size.x || at.y >= push.size.y) return;
    uvec2 key = keys.key[at.y * push.size.x + at.x];
    imageStore(depth, ivec2(at), vec4(uintBitsToFloat(key.x == NO_POINT ? BACKGROUND_BITS : key.y)));
}
