// Depth -> the same, four rows a texel, with a margin around the picture: a kernel then loads four pixels at once and needs not look where the picture ends.
//
// Points beyond the picture's edge are not known; the pixels inside stand for them as in a mirror, so that a hole at the edge is like any other.
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
    int span;          // each pixel the nearest of so many x so many, itself at the top left
} push;

void main() {
    ivec2 texel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(texel, ivec2(push.packed_size)))) return;
    ivec2 size = ivec2(push.size);
    ivec2 top = ivec2(texel.x, 4 * texel.y) - MARGIN_PX;
    vec4 four;
    [[unroll]] for (int row = 0; row < 4; ++row) {
        float nearest = uintBitsToFloat(BACKGROUND_BITS);
        for (int i = 0; i < push.span * push.span; ++i) {
            ivec2 at = top + ivec2(i % push.span, row + i / push.span);
            ivec2 mirrored = size - 1 - abs(size - 1 - abs(at));
            nearest = min(nearest, imageLoad(depth, clamp(mirrored, ivec2(0), size - 1)).r);
        }
        four[row] = nearest;
    }
    imageStore(packed_depth, texel, four);
}
