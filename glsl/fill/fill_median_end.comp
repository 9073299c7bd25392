// Filled images -> G-buffer. Pixels that nothing reached are background.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "tile.glsl"
#include "pixel.glsl"

layout(local_size_x = 64) in;

layout(scalar) readonly buffer Lists { uint word[]; } lists;
// Depth and colour (lib/pixel.glsl), four rows per texel.
layout(rgba32f) readonly uniform image2D filled_depth;
layout(rgba32f) readonly uniform image2D filled_color;
layout(r32f) uniform image2D depth;
layout(rgba32f) uniform image2D color;

layout(push_constant, scalar) uniform Push {
    uvec2 size; // pixels
    uint tiles_across;
} push;

void work(uint n) {
    uint tile = lists.word[LIST_HEADER + n];
    ivec2 top = column_of(tile, push.tiles_across);
    [[dont_unroll]] for (int half_tile = 0;; ++half_tile) {
        ivec2 texel = ivec2(top.x, top.y / 4 + half_tile);
        uvec4 depths = floatBitsToUint(imageLoad(filled_depth, texel));
        vec4 colors = imageLoad(filled_color, texel);
        [[unroll]] for (int row = 0; row < 4; ++row) {
            ivec2 pixel = ivec2(texel.x, 4 * texel.y + row);
            if ((depths[row] & FILLING) != 0u && all(lessThan(pixel, ivec2(push.size)))) {
                bool has = has_depth(depths[row]);
                imageStore(depth, pixel, vec4(uintBitsToFloat(has ? depths[row] & ~FILLING : BACKGROUND_BITS)));
                imageStore(color, pixel, has ? unpack_color(colors[row]) : vec4(0.0));
            }
        }
        if (half_tile == 1) break;
    }
}

void main() {
    EACH_OF(lists.word[3u], work)
}
