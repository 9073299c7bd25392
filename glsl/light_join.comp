// What the light sees and how deep it reaches, in a picture and in that half as wide and high -> both, as the coarser one has them where it shows a surface that is sparse in the finer one.
//
// Points of a surface that is near to a light, or sparser than others, lie texels apart in its picture. Gaps between them are closed in the picture in which they are one texel wide, whose surfaces are as
// much thicker: that is a part of their distance, which is small. What lies behind is lit no deeper than the nearer surface says; what lies beside it is seen as finely as before.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "tile.glsl"
#include "area.glsl"

layout(local_size_x = 64) in;

// All row by row. What the light sees: infinite where nothing is.
layout(scalar) readonly buffer Filled { float texel[]; } filled;
layout(scalar) readonly buffer Limit { float texel[]; } limit;
layout(scalar) readonly buffer CoarseFront { float texel[]; } coarse_front;
layout(scalar) readonly buffer CoarseLimit { float texel[]; } coarse_limit;
layout(scalar) writeonly buffer Front { float texel[]; } front;
layout(scalar) writeonly buffer Joined { float texel[]; } joined;

layout(constant_id = 0) const bool PERSPECTIVE = false;

layout(push_constant, scalar) uniform Push {
    uvec2 size;    // texels of the finer picture
    float sparse;  // of points so far apart, metres, divided by the texels that they may be apart in a picture that closes the gaps between them
    float texel;   // side of one: metres, or with perspective parts of the depth
} push;

const float FARTHEST = 3.402823466e38;

void join(uvec2 at) {
    uint texel = at.y * push.size.x + at.x;
    uint coarse = at.y / 2u * ((push.size.x + 1u) / 2u) + at.x / 2u;
    float z = coarse_front.texel[coarse];
    float reach = coarse_limit.texel[coarse];
    float own = limit.texel[texel];
    bool takes = z <= FARTHEST && reach < own && push.sparse > push.texel * (PERSPECTIVE ? z : 1.0);
    front.texel[texel] = takes ? z : filled.texel[texel];
    joined.texel[texel] = takes ? reach : own;
}

void column(uint place) {
    uint across = (push.size.x + uint(TILE_PX - 1)) / uint(TILE_PX);
    ivec2 texel = column_of(LISTED ? listed_number(place, across) : place, across);
    [[unroll]] for (int row = 0; row < TILE_PX; ++row) {
        uvec2 at = uvec2(texel + ivec2(0, row));
        if (all(lessThan(at, push.size))) join(at);
    }
}

void main() {
    uvec2 across = (push.size + uint(TILE_PX - 1)) / uint(TILE_PX);
    EACH_OF(LISTED ? listed_tiles() : across.x * across.y, column)
}
