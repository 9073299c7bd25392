// Keys of discs -> depth of the disc, and id and colour of its point, in a strip of the picture.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require

#include "pixel.glsl"
#include "pixel_index.glsl"

layout(local_size_x = 64) in;

layout(scalar) readonly buffer Keys { uvec2 key[]; } keys;
layout(r32ui) readonly uniform uimage2D index;
layout(rgba32f) readonly uniform image2D color;
layout(r32f) writeonly uniform image2D splat_depth;
layout(r32ui) writeonly uniform uimage2D splat_index;
layout(rgba32f) writeonly uniform image2D splat_color;

layout(push_constant, scalar) uniform Push {
    uvec2 size; // pixels of the strip
    uint top;   // first row of the strip
} push;

void main() {
    ivec2 at = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(at, ivec2(push.size)))) return;
    uvec2 key = keys.key[uint(at.y) * push.size.x + uint(at.x)];
    ivec2 pixel = at + ivec2(0, int(push.top));
    bool covered = key.x != NO_POINT;
    ivec2 from = covered ? in_rows(key.x, push.size.x) : pixel;
    imageStore(splat_depth, pixel, vec4(uintBitsToFloat(covered ? key.y : BACKGROUND_BITS)));
    imageStore(splat_index, pixel, uvec4(covered ? imageLoad(index, from).r : NO_POINT));
    imageStore(splat_color, pixel, covered ? imageLoad(color, from) : vec4(0.0));
}
