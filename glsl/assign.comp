// Tiles -> lists of tiles by kernel: where a hidden layer or a hole can be, and how far a pixel has to look to tell.
//
// A tile is left out where it and its neighbours are all empty, or all continuous. Elsewhere the kernel follows the density of points, taken over the tile and
// those of its neighbours that hold any: the least kernel whose `enough` share of pixels is covered, so that each sector can be expected to hold a point.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require

#include "tile.glsl"

layout(local_size_x = 64) in;

layout(scalar) readonly buffer Tiles { Tile tile[]; } tiles;
layout(scalar) buffer Lists { uint word[]; } lists;

layout(push_constant, scalar) uniform Push {
    uvec2 tiles;
    uint stride;     // words from list to list; list i has kernel 2 i + 3
    uint fixed_list; // 7: by density
    float enough[6]; // share of pixels that are covered from which kernel 3, 5, .. 13 suffices
} push;

void main() {
    uint number = gl_GlobalInvocationID.x;
    if (number >= push.tiles.x * push.tiles.y) return;
    ivec2 across = ivec2(push.tiles);
    ivec2 own = ivec2(number % push.tiles.x, number / push.tiles.x);
    uint points = 0u;
    uint held = 0u;
    bool continuous = true;
    for (int dy = -1; dy <= 1; ++dy) {
        for (int dx = -1; dx <= 1; ++dx) {
            ivec2 at = clamp(own + ivec2(dx, dy), ivec2(0), across - 1);
            Tile tile = tiles.tile[at.y * across.x + at.x];
            points += tile.points;
            held += tile.points > 0u ? 1u : 0u;
            continuous = continuous && tile.continuous == 1u;
        }
    }
    if (points == 0u || continuous) return;
    float covered = float(points) / float(held * uint(TILE_PX * TILE_PX));
    covered = max(covered, float(tiles.tile[number].points) / float(TILE_PX * TILE_PX));
    uint list = 6u;
    for (int i = 5; i >= 0; --i) {
        list = covered >= push.enough[i] ? uint(i) : list;
    }
    list = push.fixed_list < 7u ? push.fixed_list : list;
    APPEND(list * push.stride, number)
}
