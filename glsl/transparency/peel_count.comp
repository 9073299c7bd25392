// Colour of a layer, and number of surfaces in front -> number with this layer. Stored as f32,
// which is exact here, since software devices load integer images slowly.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require

#include "tile.glsl"
#include "tile_mask.glsl"

layout(local_size_x = 64) in;

layout(rgba32f) readonly uniform image2D color;
// Number in the layers in front: the same image as the one below; unread for the first.
layout(r32f) readonly uniform image2D before;
layout(r32f) writeonly uniform image2D peeled;

layout(constant_id = 0) const bool FIRST = false;

layout(push_constant, scalar) uniform Push {
    uvec2 size;
} push;

void count(ivec2 pixel) {
    if (any(greaterThanEqual(pixel, ivec2(push.size)))) return;
    float in_front = FIRST ? 0.0 : imageLoad(before, pixel).r;
    imageStore(peeled, pixel, vec4(in_front + (imageLoad(color, pixel).a > 0.0 ? 1.0 : 0.0)));
}

void main() {
    EACH_OWN_PIXEL(count)
}
