// What was filled -> layers. A pixel that nothing reached is background.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require

#include "tile.glsl"
#include "pixel.glsl"

layout(local_size_x = 64) in;

layout(scalar) readonly buffer Lists { uint word[]; } lists;
layout(rg32ui) readonly uniform uimage2D filled;
layout(r32f) uniform image2D depth;
layout(rgba32f) uniform image2D color;

layout(push_constant, scalar) uniform Push {
    uvec2 size; // pixels
    uint tiles_across;
    uint at;    // the list of tiles with pixels to fill
} push;

void main() {
    EACH_OF(lists.word[push.at + 3u]) {
        uint tile = lists.word[push.at + LIST_HEADER + n];
        for (int row = 0; row < TILE_PX; ++row) {
            ivec2 pixel = column_of(tile, push.tiles_across) + ivec2(0, row);
            bool inside = all(lessThan(pixel, ivec2(push.size)));
            uvec2 value = imageLoad(filled, min(pixel, ivec2(push.size) - 1)).rg;
            if (inside && (value.x & FILLING) != 0u) {
                bool has = has_depth(value.x);
                imageStore(depth, pixel, vec4(uintBitsToFloat(has ? value.x & ~FILLING : BACKGROUND_BITS)));
                imageStore(color, pixel, has ? vec4(unpack_color(value.y), 1.0) : vec4(0.0));
            }
        }
    }
}
