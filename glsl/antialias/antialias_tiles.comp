// Depth -> list of tiles with silhouettes (lib/silhouette.glsl).
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "pixel.glsl"
#include "tile.glsl"
#include "tile_mask.glsl"

layout(local_size_x = 64) in;

layout(r32f) readonly uniform image2D depth;
// Not 0 for listed tiles. Starts as zeros.
layout(scalar) buffer Found { uint tile[]; } found;
layout(scalar) buffer Lists { uint word[]; } lists;

layout(push_constant, scalar) uniform Push {
    uvec2 size; // pixels
    uvec2 tiles;
    float jump; // smallest Laplacian of a silhouette, as a share of the depth
    uint all;   // 1: every tile is listed
} push;

#include "silhouette.glsl"

void look(uint place) {
    uint tile = LISTED ? listed_number(place, push.tiles.x) : place;
    ivec2 last = ivec2(push.size) - 1;
    // Pixels beyond the picture read its last pixel, which is of the same tile.
    ivec2 at = min(column_of(tile, push.tiles.x), last);
    float above = imageLoad(depth, max(at - ivec2(0, 1), ivec2(0))).r;
    float own = imageLoad(depth, at).r;
    bool any_found = push.all == 1u;
    [[dont_unroll]] for (int row = 0;; ++row) {
        float left = imageLoad(depth, max(at - ivec2(1, 0), ivec2(0))).r;
        float right = imageLoad(depth, min(at + ivec2(1, 0), last)).r;
        float below = imageLoad(depth, min(at + ivec2(0, 1), last)).r;
        any_found = silhouette(float[5](own, left, right, above, below)) || any_found;
        if (row == TILE_PX - 1 || at.y == last.y) break;
        at.y += 1;
        above = own;
        own = below;
    }
    if (any_found && atomicOr(found.tile[tile], 1u) == 0u) APPEND(lists, 0u, tile)
}

void main() {
    EACH_OF(LISTED ? listed_tiles() : push.tiles.x * push.tiles.y, look)
}
