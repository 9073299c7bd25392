// Depths and limits of the half-size picture, where it shows surfaces that are sparse in the finer
// one -> the finer depths and limits, in place.
//
// Points of a surface near to the light, or sparser than others, lie texels apart in its picture.
// Their gaps are closed in the picture where they are one texel wide. Its surfaces are thicker in
// proportion, by a small share of their distance. Points behind are lit no deeper than the nearer
// surface says; points beside it keep the finer resolution. It runs over the coarser tiles that
// have something sparse.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "tile.glsl"
#include "tile_mask.glsl"

layout(local_size_x = 64) in;

// All row by row. Depths: infinite where empty, and in the coarser picture where nothing is sparse.
layout(scalar) readonly buffer CoarseFront { float texel[]; } coarse_front;
layout(scalar) readonly buffer CoarseLimit { float texel[]; } coarse_limit;
layout(scalar) buffer Front { float texel[]; } front;
layout(scalar) buffer Limit { float texel[]; } limit;

layout(push_constant, scalar) uniform Push {
    uvec2 size;   // texels of the finer picture
    float within; // depth up to which surfaces are sparse in it [m]
} push;

uvec2 half_size() {
    return (push.size + 1u) / 2u;
}

void column(uint place) {
    uvec2 across = (half_size() + uint(TILE_PX - 1)) / uint(TILE_PX);
    ivec2 top = column_of(LISTED ? listed_number(place, across.x) : place, across.x);
    [[dont_unroll]] for (int row = 0;; ++row) {
        // Texels beyond the edges repeat the last one and get the same result.
        uvec2 coarse = min(uvec2(top + ivec2(0, row)), half_size() - 1u);
        uint at = coarse.y * half_size().x + coarse.x;
        float z = coarse_front.texel[at];
        float reach = coarse_limit.texel[at];
        [[unroll]] for (uint k = 0u; k < 4u; ++k) {
            uvec2 fine = min(2u * coarse + uvec2(k % 2u, k / 2u), push.size - 1u);
            uint texel = fine.y * push.size.x + fine.x;
            if (z < push.within && reach < limit.texel[texel]) {
                front.texel[texel] = z;
                limit.texel[texel] = reach;
            }
        }
        if (row == TILE_PX - 1) break;
    }
}

void main() {
    uvec2 across = (half_size() + uint(TILE_PX - 1)) / uint(TILE_PX);
    EACH_OF(LISTED ? listed_tiles() : across.x * across.y, column)
}
