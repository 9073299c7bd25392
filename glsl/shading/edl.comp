// Eye-dome lighting (Boucheny 2009, ch. 5; Ribes and Boucheny 2011): darkens a pixel by how far its
// neighbours lie in front of it.
//
//   slope_k = max(0, (depth - depth_k) / width of radius_px pixels at this depth)   for 8 neighbours
//   shaded  = color * exp2(-strength * mean(slope))
// A slope has no unit, so neither the scale of the cloud nor the size of the picture changes the
// shading. Empty pixels and those outside of the picture are never in front. The exponential is our
// own, since the built-in one differs between drivers.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require

#include "exact_exp.glsl"
#include "tile.glsl"
#include "tile_mask.glsl"

layout(local_size_x = 64) in;

layout(r32f) readonly uniform image2D depth;
layout(rgba32f) readonly uniform image2D color;
layout(rgba32f) writeonly uniform image2D shaded;

layout(constant_id = 0) const bool PERSPECTIVE = true;

layout(push_constant, scalar) uniform Push {
    uvec2 size;      // pixels
    float strength;
    float slope_cap; // steepest slope that counts
    float px_per_unit; // perspective: focal length in pixels; orthographic: pixels per metre
    int radius_px;
} push;

void shade(ivec2 pixel) {
    ivec2 size = ivec2(push.size);
    if (pixel.x >= size.x || pixel.y >= size.y) return;
    float z = imageLoad(depth, pixel).r;
    vec4 c = imageLoad(color, pixel);
    bool empty = c.a == 0.0;
    float width = PERSPECTIVE ? (empty ? 1.0 : z) : 1.0;
    float sum = 0.0;
    for (int dy = -1; dy <= 1; ++dy) {
        for (int dx = -1; dx <= 1; ++dx) {
            if (dx == 0 && dy == 0) continue;
            ivec2 q = pixel + ivec2(dx, dy) * push.radius_px;
            bool inside = q.x >= 0 && q.y >= 0 && q.x < size.x && q.y < size.y;
            float zk = imageLoad(depth, clamp(q, ivec2(0), size - 1)).r;
            // Empty pixels are infinitely far. Unlike a difference of infinities, a comparison is
            // always defined.
            bool before = inside && !empty && zk < z;
            float slope = (before ? z - zk : 0.0) / width * push.px_per_unit / float(push.radius_px);
            sum += min(slope, push.slope_cap);
        }
    }
    float shade = exact_exp2(-push.strength * (sum / 8.0));
    imageStore(shaded, pixel, vec4(c.rgb * shade, c.a));
}

void main() {
    EACH_OWN_PIXEL(shade)
}
