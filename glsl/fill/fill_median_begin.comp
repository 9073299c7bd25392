// G-buffer -> images that filling alternates between: the tiles with pixels to fill, and a rim
// around them at least as wide as a pixel looks.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "tile.glsl"
#include "pixel.glsl"

layout(local_size_x = 64) in;

layout(scalar) readonly buffer Lists { uint word[]; } lists;
layout(r32f) readonly uniform image2D depth;
layout(rgba32f) readonly uniform image2D color;
// Depth and colour (lib/pixel.glsl), four rows per texel.
layout(rgba32f) writeonly uniform image2D even_depth;
layout(rgba32f) writeonly uniform image2D even_color;
layout(rgba32f) writeonly uniform image2D odd_depth;
layout(rgba32f) writeonly uniform image2D odd_color;

layout(push_constant, scalar) uniform Push {
    uint tiles_across;
} push;

void open(ivec2 texel) {
    vec4 depths;
    vec4 colors;
    // Pixels beyond the picture read 0: no depth.
    [[unroll]] for (int row = 0; row < 4; ++row) {
        ivec2 pixel = ivec2(texel.x, 4 * texel.y + row);
        depths[row] = imageLoad(depth, pixel).r;
        colors[row] = pack_color(imageLoad(color, pixel));
    }
    imageStore(even_depth, texel, depths);
    imageStore(odd_depth, texel, depths);
    imageStore(even_color, texel, colors);
    imageStore(odd_color, texel, colors);
}

void work(uint n) {
    uint tile = lists.word[LIST_HEADER + n];
    ivec2 corner = tile_corner(tile, push.tiles_across) / ivec2(1, 4);
    // The tile's two rows of texels, one above, one below, and a column on either side.
    [[dont_unroll]] for (int i = int(gl_LocalInvocationID.x % 8u);; i += 8) {
        open(corner + ivec2(i % 10, i / 10) - 1);
        if (i >= 32) break;
    }
}

void main() {
    EACH_OF(lists.word[3u], work)
}
