// Depths -> filled pixels, and the list of tiles with one of them or of their neighbours.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "tile.glsl"
#include "tile_mask.glsl"

layout(local_size_x = 64) in;

// Projected depth, and depth after filling: they differ where pixels were filled.
layout(r32f) readonly uniform image2D projected_depth;
layout(r32f) readonly uniform image2D filled;
// One bit per pixel for every column of every tile, from the top. Starts as zeros.
layout(scalar) writeonly buffer Pixels { uint column[]; } pixels;
// Not 0 for listed tiles. Starts as zeros.
layout(scalar) buffer Found { uint tile[]; } found;
layout(scalar) buffer Lists { uint word[]; } lists;

layout(push_constant, scalar) uniform Push {
    uvec2 tiles;
    uint all; // 1: every pixel is smoothed
} push;

void look(uint place) {
    uint tile = LISTED ? listed_number(place, push.tiles.x) : place;
    ivec2 at = in_rows(tile, push.tiles.x);
    int column = int(gl_LocalInvocationID.x % 8u);
    uint bits = push.all == 1u ? 255u : 0u;
    // Both are 0 beyond the picture.
    [[unroll]] for (int row = 0; row < TILE_PX; ++row) {
        ivec2 pixel = TILE_PX * at + ivec2(column, row);
        bool taken = floatBitsToUint(imageLoad(projected_depth, pixel).r) != floatBitsToUint(imageLoad(filled, pixel).r);
        bits |= uint(taken) << row;
    }
    if (bits == 0u) return;
    pixels.column[tile * 8u + uint(column)] = bits;
    ivec2 first = max(at - ivec2(column == 0 ? 1 : 0, int(bits & 1u)), ivec2(0));
    ivec2 last = min(at + ivec2(column == 7 ? 1 : 0, int(bits >> 7)), ivec2(push.tiles) - 1);
    for (int y = first.y; y <= last.y; ++y) {
        for (int x = first.x; x <= last.x; ++x) {
            uint near = uint(y) * push.tiles.x + uint(x);
            if (found.tile[near] == 0u && atomicExchange(found.tile[near], 1u) == 0u) APPEND(lists, 0u, near)
        }
    }
}

void main() {
    EACH_OF(LISTED ? listed_tiles() : push.tiles.x * push.tiles.y, look)
}
