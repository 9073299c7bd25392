// Depth as projected -> not 0 where a pixel holds a point.
#version 460
#extension GL_EXT_scalar_block_layout : require

layout(local_size_x = 64) in;

layout(r32f) readonly uniform image2D depth;
layout(scalar) buffer Covered { uint any[]; } covered;

layout(push_constant, scalar) uniform Push {
    uvec2 size; // pixels
} push;

const float FARTHEST = 3.402823466e38;

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, ivec2(push.size)))) return;
    // One is enough: an atomic for every pixel would be most of this pass.
    if (imageLoad(depth, pixel).r <= FARTHEST && covered.any[0] == 0u) atomicOr(covered.any[0], 1u);
}
