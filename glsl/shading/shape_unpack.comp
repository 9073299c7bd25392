// Shade with four rows per texel -> one pixel per texel.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require

layout(local_size_x = 64) in;

layout(rgba32f) readonly uniform image2D shade;
layout(r32f) writeonly uniform image2D shading;

layout(push_constant, scalar) uniform Push {
    uvec2 size; // pixels
} push;

void main() {
    ivec2 texel = ivec2(gl_GlobalInvocationID.xy);
    if (texel.x >= int(push.size.x)) return;
    vec4 four = imageLoad(shade, texel);
    [[unroll]] for (int row = 0; row < 4; ++row) {
        ivec2 pixel = ivec2(texel.x, 4 * texel.y + row);
        if (pixel.y < int(push.size.y)) imageStore(shading, pixel, vec4(four[row]));
    }
}
