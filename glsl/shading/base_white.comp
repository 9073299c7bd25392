// Colour -> white with the same alpha, so that only the shading shows.
#version 460
#extension GL_EXT_scalar_block_layout : require

layout(local_size_x = 64) in;

layout(rgba32f) readonly uniform image2D color;
layout(rgba32f) writeonly uniform image2D white;

layout(push_constant, scalar) uniform Push {
    uvec2 size; // pixels
} push;

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, ivec2(push.size)))) return;
    float alpha = imageLoad(color, pixel).a;
    imageStore(white, pixel, vec4(alpha));
}
