// A plain mean over 3 x 3: the unit of benchmarks.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require

layout(local_size_x = 64) in;

layout(r32f) readonly uniform image2D depth;
layout(r32f) writeonly uniform image2D mean;

layout(push_constant, scalar) uniform Push {
    uvec2 size; // pixels
} push;

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (pixel.x >= int(push.size.x) || pixel.y >= int(push.size.y)) return;
    float sum = 0.0;
    [[unroll]] for (int k = 0; k < 9; ++k) {
        sum += imageLoad(depth, clamp(pixel + ivec2(k % 3, k / 3) - 1, ivec2(0), ivec2(push.size) - 1)).r;
    }
    imageStore(mean, pixel, vec4(sum / 9.0));
}
