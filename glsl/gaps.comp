// Tiles -> how far apart points of the nearest surface are in a block of tiles that lies within it, pixels; 0 of others.
//
// It lies within where all nine blocks around hold points of one surface: at a silhouette what lies beyond would be taken for gaps. Where some of the block is something else all the same, as in a slit, the points of a dense surface
// have others beside them: the share of their neighbours that hold one is what they fill where they are, and the larger of both shares counts. Blocks are tiles, and, for gaps so wide that tiles lie
// in them, two by two of these.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "tile.glsl"

layout(local_size_x = 64) in;

layout(scalar) readonly buffer Tiles { Tile tile[]; } tiles;
layout(scalar) writeonly buffer Gaps { float block[]; } gaps;

layout(constant_id = 0) const bool PERSPECTIVE = true;
layout(constant_id = 1) const uint TILES = 1u; // tiles across and down a block

layout(push_constant, scalar) uniform Push {
    uvec2 tiles;
    uvec2 blocks;
    float px_per_unit; // as in classify.comp
    float front_px;    // times SPAN
} push;

const float FARTHEST = 3.402823466e38;
const int SPAN = int(TILES);
// What `pairs` can be at most, a pixel: nearly all have a neighbour to their right, and one below.
const float PAIRS = 2.0 * float(TILE_PX - 1) / float(TILE_PX);

// Of a block what a tile has.
struct Block {
    float nearest;
    float front;
    float pairs;
};

Block block_at(ivec2 at) {
    Block block = Block(FARTHEST, 0.0, 0.0);
    ivec2 first = SPAN * clamp(at, ivec2(0), ivec2(push.blocks) - 1);
    ivec2 last = min(first + SPAN, ivec2(push.tiles)) - 1;
    [[dont_unroll]] for (int pass = SPAN == 1 ? 1 : 0; pass < 2; ++pass) {
        [[dont_unroll]] for (int k = 0; k < SPAN * SPAN; ++k) {
            ivec2 own = min(first + ivec2(k % SPAN, k / SPAN), last);
            Tile tile = tiles.tile[own.y * int(push.tiles.x) + own.x];
            bool within = all(equal(own, first + ivec2(k % SPAN, k / SPAN))) && tile.points > 0u;
            block.nearest = within ? min(block.nearest, tile.nearest) : block.nearest;
            bool counts = pass == 1 && within && in_front(tile.nearest, block.nearest, push.front_px, push.px_per_unit, PERSPECTIVE);
            block.front += counts ? float(in_quarters(tile.front)) : 0.0;
            block.pairs += counts ? float(tile.pairs) : 0.0;
        }
    }
    return block;
}

void main() {
    uint number = gl_GlobalInvocationID.x;
    if (number >= push.blocks.x * push.blocks.y) return;
    ivec2 at = in_rows(number, push.blocks.x);
    float nearest = FARTHEST;
    float farthest = 0.0;
    bool within = true;
    Block own;
    [[dont_unroll]] for (int k = 0; k < 9; ++k) {
        Block block = block_at(at + ivec2(k % 3 - 1, k / 3 - 1));
        within = within && block.front > 0.0;
        nearest = min(nearest, block.nearest);
        farthest = max(farthest, block.nearest);
        if (k == 4) own = block;
    }
    within = within && in_front(farthest, nearest, push.front_px, push.px_per_unit, PERSPECTIVE);
    float share = max(own.front / float(SPAN * TILE_PX * SPAN * TILE_PX), own.pairs / (PAIRS * max(own.front, 1.0)));
    gaps.block[number] = within ? apart(share) : 0.0;
}
