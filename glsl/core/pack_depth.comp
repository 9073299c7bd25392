// Depth -> the same with four rows per texel, for kernels that look far. A margin saves them from
// testing for the edge.
//
// Points beyond the picture's edge are unknown. Edge pixels are repeated there, so that a hole at
// the edge is like any other.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "pixel.glsl"
#include "tile.glsl"

layout(local_size_x = 64) in;

layout(r32f) readonly uniform image2D depth;
layout(rgba32f) writeonly uniform image2D packed_depth;

layout(push_constant, scalar) uniform Push {
    uvec2 size;        // pixels
    uvec2 packed_size; // texels
    int margin;        // pixels around the picture, a multiple of 4
    uint mirror;       // 1: mirrored margin; 0: repeated edge pixels
} push;

void main() {
    ivec2 texel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(texel, ivec2(push.packed_size)))) return;
    ivec2 size = ivec2(push.size);
    ivec2 top = ivec2(texel.x, 4 * texel.y) - push.margin;
    int x = push.mirror == 1u ? size.x - 1 - abs(size.x - 1 - abs(top.x)) : top.x;
    vec4 four;
    [[unroll]] for (int row = 0; row < 4; ++row) {
        int y = push.mirror == 1u ? size.y - 1 - abs(size.y - 1 - abs(top.y + row)) : top.y + row;
        // Without a margin, pixels beyond the picture read 0: no depth.
        four[row] = imageLoad(depth, push.margin > 0 ? clamp(ivec2(x, y), ivec2(0), size - 1) : top + ivec2(0, row)).r;
    }
    imageStore(packed_depth, texel, four);
}
