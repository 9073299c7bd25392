// Projected depth -> tiles that hold points.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "tile.glsl"
#include "tile_mask.glsl"

layout(local_size_x = 64) in;

layout(r32f) readonly uniform image2D depth;
// Not 0 for tiles that hold points.
layout(scalar) buffer Covered { uint tile[]; } covered;

layout(push_constant, scalar) uniform Push {
    uvec2 tiles;
} push;

const float FARTHEST = 3.402823466e38;

void cover(uint place) {
    uint tile = LISTED ? listed_number(place, push.tiles.x) : place;
    ivec2 top = column_of(tile, push.tiles.x);
    bool any_point = false;
    // Depths outside of the image are 0.
    [[unroll]] for (int row = 0; row < TILE_PX; ++row) {
        float z = imageLoad(depth, top + ivec2(0, row)).r;
        any_point = any_point || (z > 0.0 && z <= FARTHEST);
    }
    if (any_point) atomicOr(covered.tile[tile], 1u);
}

void main() {
    EACH_OF(LISTED ? listed_tiles() : push.tiles.x * push.tiles.y, cover)
}
