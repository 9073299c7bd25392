// Keys or depths of the light's picture -> tiles that hold points that are near enough.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "pixel.glsl"
#include "tile.glsl"
#include "tile_mask.glsl"

layout(local_size_x = 64) in;

#include "light_depth.glsl"

// Not 0 for tiles that hold points.
layout(scalar) buffer Covered { uint tile[]; } covered;

void cover(uint place) {
    ivec2 top = column_of(place, light_tiles().x);
    bool any_point = false;
    [[unroll]] for (int row = 0; row < TILE_PX; ++row) {
        ivec2 at = top + ivec2(0, row);
        bool inside = all(lessThan(at, ivec2(push.size)));
        float z = depth_of(at.y * int(push.size.x) + at.x);
        any_point = any_point || (is_depth(z) && z < push.within && inside);
    }
    if (any_point) atomicOr(covered.tile[place], 1u);
}

void main() {
    EACH_OF(light_tiles().x * light_tiles().y, cover)
}
