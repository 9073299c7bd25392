// Tiles -> how far apart points of the nearest surface are in a tile that lies within it, pixels; 0 of others.
//
// It lies within where all nine tiles around hold points of one surface: at a silhouette what lies beyond would be taken for gaps. Where some of the tile is something else all the same, as in a slit, the points of a dense surface have
// others beside them: the share of their neighbours that hold one is what they fill where they are, and the larger of both shares counts.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "tile.glsl"

layout(local_size_x = 64) in;

layout(scalar) readonly buffer Tiles { Tile tile[]; } tiles;
layout(scalar) writeonly buffer Gaps { float tile[]; } gaps;

layout(push_constant, scalar) uniform Push {
    uvec2 tiles;
    float px_per_unit; // as in classify.comp
    float front_px;
} push;

layout(constant_id = 0) const bool PERSPECTIVE = true;

const float FARTHEST = 3.402823466e38;
// Pixels of a tile that have a neighbour in it to their right, and those that have one below, over all: what `pairs` can be at most, a pixel.
const float PAIRS = 2.0 * float(TILE_PX - 1) / float(TILE_PX);

void main() {
    uint number = gl_GlobalInvocationID.x;
    if (number >= push.tiles.x * push.tiles.y) return;
    ivec2 across = ivec2(push.tiles);
    ivec2 own = in_rows(number, push.tiles.x);
    float nearest = FARTHEST;
    float farthest = 0.0;
    bool within = true;
    [[dont_unroll]] for (int dy = -1; dy <= 1; ++dy) {
        [[dont_unroll]] for (int dx = -1; dx <= 1; ++dx) {
            ivec2 at = clamp(own + ivec2(dx, dy), ivec2(0), across - 1);
            Tile tile = tiles.tile[at.y * across.x + at.x];
            within = within && tile.front > 0u;
            nearest = min(nearest, tile.nearest);
            farthest = max(farthest, tile.nearest);
        }
    }
    within = within && in_front(farthest, nearest, push.front_px, push.px_per_unit, PERSPECTIVE);
    Tile tile = tiles.tile[number];
    float front = float(in_quarters(tile.front));
    float share = max(front / float(TILE_PX * TILE_PX), float(tile.pairs) / (PAIRS * max(front, 1.0)));
    gaps.tile[number] = within ? apart(share) : 0.0;
}
