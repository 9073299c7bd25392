// Layers -> the two images that filling goes back and forth between: of all tiles with pixels to fill, and a rim of one pixel around them, which is as far as a pixel looks.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require

#include "tile.glsl"
#include "pixel.glsl"

layout(local_size_x = 64) in;

layout(scalar) readonly buffer Lists { uint word[]; } lists;
layout(r32f) readonly uniform image2D depth;
layout(rgba32f) readonly uniform image2D color;
layout(rg32ui) writeonly uniform uimage2D even;
layout(rg32ui) writeonly uniform uimage2D odd;

layout(push_constant, scalar) uniform Push {
    uvec2 size; // pixels
    uint tiles_across;
    uint at;    // the list of tiles with pixels to fill
} push;

void open(ivec2 pixel) {
    if (any(lessThan(pixel, ivec2(0))) || any(greaterThanEqual(pixel, ivec2(push.size)))) return;
    uvec4 value = uvec4(floatBitsToUint(imageLoad(depth, pixel).r), pack_color(imageLoad(color, pixel).rgb), 0u, 0u);
    imageStore(even, pixel, value);
    imageStore(odd, pixel, value);
}

void main() {
    EACH_OF(lists.word[push.at + 3u]) {
        uint tile = lists.word[push.at + LIST_HEADER + n];
        ivec2 corner = tile_corner(tile, push.tiles_across);
        int lane = int(gl_LocalInvocationID.x % 8u);
        for (int row = -1; row <= TILE_PX; ++row) {
            open(corner + ivec2(lane, row));
        }
        // The rim's left and right sides: ten pixels each, among eight lanes.
        for (int row = lane - 1; row <= TILE_PX; row += 8) {
            open(corner + ivec2(-1, row));
            open(corner + ivec2(TILE_PX, row));
        }
    }
}
