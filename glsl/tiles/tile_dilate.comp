// Marked tiles -> list of these and the tiles within `rings` of them, for passes with a tile mask
// (lib/tile_mask.glsl): column, and row in the upper half of the word.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require

#include "tile.glsl"

layout(local_size_x = 64) in;

layout(scalar) readonly buffer Covered { uint tile[]; } covered;
// Starts as zeros.
layout(scalar) buffer Lists { uint word[]; } lists;

layout(push_constant, scalar) uniform Push {
    uvec2 tiles;
    int rings; // rings of tiles listed around a tile
} push;

void main() {
    uint number = gl_GlobalInvocationID.x;
    if (number >= push.tiles.x * push.tiles.y) return;
    ivec2 tile = in_rows(number, uint(push.tiles.x));
    ivec2 first = max(tile - push.rings, ivec2(0));
    ivec2 last = min(tile + push.rings, ivec2(push.tiles) - 1);
    uint near = 0u;
    for (int y = first.y; y <= last.y; ++y) {
        for (int x = first.x; x <= last.x; ++x) near |= covered.tile[uint(y) * push.tiles.x + uint(x)];
    }
    if (near == 0u) return;
    APPEND(lists, 0u, uint(tile.y) << 16 | uint(tile.x))
}
