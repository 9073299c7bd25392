// Results of anti-aliasing in listed tiles -> G-buffer.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "tile.glsl"

layout(local_size_x = 64) in;

layout(scalar) readonly buffer Lists { uint word[]; } lists;
layout(rgba32f) readonly uniform image2D blended;
layout(r32f) readonly uniform image2D remaining_shading;
layout(rgba32f) writeonly uniform image2D color;
layout(r32f) writeonly uniform image2D shading;

layout(constant_id = 0) const bool HAS_SHADING = false;

layout(push_constant, scalar) uniform Push {
    uint tiles_across;
} push;

void work(uint n) {
    ivec2 pixel = column_of(lists.word[LIST_HEADER + n], push.tiles_across);
    // Pixels beyond the picture are not written.
    [[unroll]] for (int row = 0; row < TILE_PX; ++row) {
        imageStore(color, pixel, imageLoad(blended, pixel));
        if (HAS_SHADING) imageStore(shading, pixel, imageLoad(remaining_shading, pixel));
        pixel.y += 1;
    }
}

void main() {
    EACH_OF(lists.word[3], work)
}
