// Keys of a strip and its surroundings -> keys of the strip on surfaces, none elsewhere.
#version 460
#extension GL_EXT_scalar_block_layout : require

layout(local_size_x = 64) in;

layout(scalar) readonly buffer Surface { uint word[]; } surface;
layout(scalar) readonly buffer Around { uvec2 key[]; } around;
layout(scalar) writeonly buffer Keys { uvec2 key[]; } keys;

layout(push_constant, scalar) uniform Push {
    uint width;  // pixels of the strip
    uint border; // around it
} push;

void main() {
    uvec2 pixel = gl_GlobalInvocationID.xy;
    if (pixel.x >= push.width) return;
    uint own = pixel.y * push.width + pixel.x;
    uvec2 key = around.key[(pixel.y + push.border) * (push.width + 2u * push.border) + pixel.x + push.border];
    keys.key[own] = surface.word[own] == 0u ? uvec2(0xFFFFFFFFu) : key;
}
