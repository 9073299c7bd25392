// What was filled -> layers. A pixel that nothing reached is background.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require

#include "tile.glsl"
#include "pixel.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

layout(scalar) readonly buffer Lists { uint word[]; } lists;
layout(rg32ui) readonly uniform uimage2D filled;
layout(r32f) uniform image2D depth;
layout(rgba32f) uniform image2D color;

layout(push_constant, scalar) uniform Push {
    uvec2 size;  // pixels
    uvec2 tiles;
    uint at;     // the list of tiles with pixels to fill
} push;

void main() {
    uint count = lists.word[push.at + 3u];
    for (uint n = gl_WorkGroupID.x; n < count; n += gl_NumWorkGroups.x) {
        uint tile = lists.word[push.at + LIST_HEADER + n];
        ivec2 pixel = tile_corner(tile, push.tiles.x) + ivec2(gl_LocalInvocationID.xy);
        bool inside = pixel.x < int(push.size.x) && pixel.y < int(push.size.y);
        uvec2 value = imageLoad(filled, clamp(pixel, ivec2(0), ivec2(push.size) - 1)).rg;
        if (inside && (value.x & FILLING) != 0u) {
            bool has = has_depth(value.x);
            imageStore(depth, pixel, vec4(uintBitsToFloat(has ? value.x & ~FILLING : BACKGROUND_BITS)));
            imageStore(color, pixel, has ? vec4(unpack_color(value.y), 1.0) : vec4(0.0));
        }
    }
}
