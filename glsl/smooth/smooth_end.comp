// Results of smoothing in listed tiles -> G-buffer.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "tile.glsl"

layout(local_size_x = 64) in;

layout(scalar) readonly buffer Lists { uint word[]; } lists;
layout(r32f) readonly uniform image2D smooth_depth;
layout(rgba32f) readonly uniform image2D smooth_color;
layout(rgba32f) readonly uniform image2D smooth_shadow_factor;
layout(r32f) writeonly uniform image2D depth;
layout(rgba32f) writeonly uniform image2D color;
layout(rgba32f) writeonly uniform image2D shadow_factor;

layout(constant_id = 0) const bool SHADOWED = false;

layout(push_constant, scalar) uniform Push {
    uint tiles_across;
} push;

ivec2 tile_at(uint place) {
    return in_rows(lists.word[LIST_HEADER + place], push.tiles_across);
}

// Pixels beyond the picture are not written.
void close(ivec2 pixel) {
    imageStore(depth, pixel, imageLoad(smooth_depth, pixel));
    imageStore(color, pixel, imageLoad(smooth_color, pixel));
    if (SHADOWED) imageStore(shadow_factor, pixel, imageLoad(smooth_shadow_factor, pixel));
}

void main() {
    EACH_TEXEL_OF(lists.word[3], tile_at, 1, close)
}
