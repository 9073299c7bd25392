// Takes invisible pixels out of the layers: their depth becomes minus infinity, "not known", where the background's is plus infinity.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require

#include "tile.glsl"
#include "pixel.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

layout(scalar) readonly buffer Lists { uint word[]; } lists;
layout(scalar) readonly buffer Invisible { uint word[]; } invisible;
layout(r32f) uniform image2D depth;
layout(r32ui) uniform uimage2D index;
layout(rgba32f) uniform image2D color;

layout(push_constant, scalar) uniform Push {
    uint tiles_across;
    uint at; // the list of tiles with invisible pixels
} push;

void main() {
    uint count = lists.word[push.at + 3u];
    for (uint n = gl_WorkGroupID.x; n < count; n += gl_NumWorkGroups.x) {
        uint tile = lists.word[push.at + LIST_HEADER + n];
        uint bit = gl_LocalInvocationIndex;
        if ((invisible.word[WORDS_PER_TILE * tile + bit / 32u] >> (bit & 31u) & 1u) == 1u) {
            ivec2 pixel = tile_corner(tile, push.tiles_across) + ivec2(gl_LocalInvocationID.xy);
            imageStore(depth, pixel, vec4(uintBitsToFloat(UNKNOWN_BITS)));
            imageStore(index, pixel, uvec4(NO_POINT));
            imageStore(color, pixel, vec4(0.0));
        }
    }
}
