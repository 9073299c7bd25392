// Depth as projected -> which tiles hold points.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require

#include "tile.glsl"
#include "area.glsl"

layout(local_size_x = 64) in;

layout(r32f) readonly uniform image2D depth;
// Of every tile, not 0 where it holds points.
layout(scalar) buffer Covered { uint tile[]; } covered;

layout(push_constant, scalar) uniform Push {
    uvec2 size; // pixels
    uint tiles_across;
} push;

const float FARTHEST = 3.402823466e38;

void main() {
    ivec2 pixel = own_pixel(push.size.x);
    if (any(greaterThanEqual(pixel, ivec2(push.size)))) return;
    uint tile = uint(pixel.y / TILE_PX) * push.tiles_across + uint(pixel.x / TILE_PX);
    // One is enough: an atomic for every pixel would be most of this pass.
    if (imageLoad(depth, pixel).r <= FARTHEST && covered.tile[tile] == 0u) atomicOr(covered.tile[tile], 1u);
}
