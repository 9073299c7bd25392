// Marks and point ids -> colour times the light that reaches the point: ambient + mark (1 - ambient) (Dobrev et al. 2010, sec. 6).
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require

#include "pixel.glsl"
#include "tile.glsl"
#include "area.glsl"

layout(local_size_x = 64) in;

layout(r32ui) readonly uniform uimage2D index;
// A byte a point: how many samples light it.
layout(scalar) readonly buffer Marks { uint word[]; } marks;
layout(rgba32f) uniform image2D color;

layout(push_constant, scalar) uniform Push {
    uvec2 size;    // pixels
    float samples; // of the light
    float ambient;
} push;

void main() {
    ivec2 pixel = own_pixel(push.size.x);
    if (any(greaterThanEqual(pixel, ivec2(push.size)))) return;
    uint point = imageLoad(index, pixel).r;
    uint at = point == NO_POINT ? 0u : point;
    uint count = marks.word[at / 4u] >> (8u * (at & 3u)) & 255u;
    vec4 c = imageLoad(color, pixel);
    // On the border of two of the light's pictures both may count a point.
    float lit = min(float(count), push.samples) / push.samples;
    c.rgb *= push.ambient + (1.0 - push.ambient) * lit;
    imageStore(color, pixel, c);
}
