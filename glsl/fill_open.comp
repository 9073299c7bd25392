// Layers -> the two images that filling goes back and forth between: of all tiles with pixels to fill, and the tiles around them.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require

#include "tile.glsl"
#include "pixel.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

layout(scalar) readonly buffer Lists { uint word[]; } lists;
layout(r32f) readonly uniform image2D depth;
layout(rgba32f) readonly uniform image2D color;
layout(rg32ui) writeonly uniform uimage2D even;
layout(rg32ui) writeonly uniform uimage2D odd;

layout(push_constant, scalar) uniform Push {
    uvec2 size; // pixels
    uvec2 tiles;
    uint at;    // the list of tiles with pixels to fill
} push;

void main() {
    uint count = lists.word[push.at + 3u];
    for (uint n = gl_WorkGroupID.x; n < count; n += gl_NumWorkGroups.x) {
        uint tile = lists.word[push.at + LIST_HEADER + n];
        // A pixel looks one pixel far: the tile and a rim of one.
        for (uint i = gl_LocalInvocationIndex; i < uint((TILE_PX + 2) * (TILE_PX + 2)); i += 64u) {
            ivec2 pixel = tile_corner(tile, push.tiles.x) + ivec2(i % uint(TILE_PX + 2), i / uint(TILE_PX + 2)) - 1;
            bool inside = all(greaterThanEqual(pixel, ivec2(0))) && all(lessThan(pixel, ivec2(push.size)));
            ivec2 at = clamp(pixel, ivec2(0), ivec2(push.size) - 1);
            uvec4 value = uvec4(floatBitsToUint(imageLoad(depth, at).r), pack_color(imageLoad(color, at).rgb), 0u, 0u);
            if (inside) {
                imageStore(even, pixel, value);
                imageStore(odd, pixel, value);
            }
        }
    }
}
