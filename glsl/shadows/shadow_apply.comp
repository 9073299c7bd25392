// Visibility of the light, point ids and colour -> colour times ambient + visibility (1 - ambient);
// or, if lighting follows, the visibility in red, green and blue (Dobrev et al. 2010, sec. 6).
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_buffer_reference_uvec2 : require
#extension GL_GOOGLE_include_directive : require

#include "pixel.glsl"
#include "drawn_node.glsl"
#include "tile.glsl"
#include "tile_mask.glsl"

// Saved visibility of the points of a node: a page of 32-bit words.
layout(buffer_reference, scalar, buffer_reference_align = 4) readonly buffer Plane { uint word[]; };

layout(local_size_x = 64) in;

layout(r32ui) readonly uniform uimage2D index;
// Number of samples that light each point, one byte.
layout(scalar) readonly buffer LightVisibility { uint word[]; } light_visibility;
// Address of the page with each node's saved visibility, two words.
layout(scalar) readonly buffer Saved { uvec2 page[]; } saved;
layout(rgba32f) readonly uniform image2D color;
layout(rgba32f) writeonly uniform image2D shaded;

layout(constant_id = 0) const bool SAVED = false;
layout(constant_id = 1) const bool APART = false;

layout(push_constant, scalar) uniform Push {
    uvec2 size;    // pixels
    float full;    // value of a fully lit point
    float ambient;
} push;

void light(ivec2 pixel) {
    if (any(greaterThanEqual(pixel, ivec2(push.size)))) return;
    uint point = imageLoad(index, pixel).r;
    uint at = point == NO_POINT ? 0u : point;
    uint count = 0u;
    if (!SAVED) count = light_visibility.word[at / 4u] >> (8u * (at & 3u)) & 255u;
    if (SAVED && point != NO_POINT) count = Plane(saved.page[point >> POINTS_PER_PAGE_LOG2]).word[point & (POINTS_PER_PAGE - 1u)];
    vec4 c = imageLoad(color, pixel);
    // Two pictures of the light may count a point on their border.
    float lit = min(float(count), push.full) / push.full;
    c.rgb = mix(c.rgb * (push.ambient + (1.0 - push.ambient) * lit), vec3(lit), bvec3(APART));
    imageStore(shaded, pixel, c);
}

void main() {
    EACH_OWN_PIXEL(light)
}
