// Normals of points -> normals of pixels: right, down and away from the camera, turned towards it,
// and 1; 0 for pixels without a point or a known normal.
//
// Normals of files or fitted planes may have either sign; here they face the camera.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_buffer_reference_uvec2 : require
#extension GL_GOOGLE_include_directive : require

#include "drawn_node.glsl"
#include "exact_dot.glsl"
#include "normalize.glsl"
#include "octahedral.glsl"
#include "tile.glsl"
#include "tile_mask.glsl"

// Normals of the points of a node: a page of 32-bit words.
layout(buffer_reference, scalar, buffer_reference_align = 4) readonly buffer Plane { uint word[]; };

layout(local_size_x = 64) in;

layout(r32ui) readonly uniform uimage2D index;
// Address of the page with each node's normals, two words.
layout(scalar) readonly buffer Facings { uvec2 page[]; } facings;
layout(rgba32f) writeonly uniform image2D facing;

layout(constant_id = 0) const bool PERSPECTIVE = true;
// True if a linear map has changed lengths.
layout(constant_id = 1) const bool MAPPED = false;

layout(push_constant, scalar) uniform Push {
    uvec2 size;        // pixels
    vec2 centre;       // principal point [px]
    float px_per_unit; // perspective: focal length in pixels; orthographic: pixels per metre
    vec3 right;        // the camera's axes, for products with normals of the cloud
    vec3 down;
    vec3 forward;
} push;

const uint NO_POINT = 0xFFFFFFFFu;

void face(ivec2 pixel) {
    if (any(greaterThanEqual(pixel, ivec2(push.size)))) return;
    uint id = imageLoad(index, pixel).r;
    uint word = UNKNOWN_NORMAL;
    if (id != NO_POINT) word = Plane(facings.page[id >> POINTS_PER_PAGE_LOG2]).word[id & (POINTS_PER_PAGE - 1u)];
    bool known = (word & UNKNOWN_NORMAL) != UNKNOWN_NORMAL;
    vec3 world = normal_of(known ? word : 0u);
    vec3 n = vec3(dot_of(push.right, world), dot_of(push.down, world), dot_of(push.forward, world));
    if (MAPPED) n = unit(n);
    vec2 across = (vec2(pixel) + 0.5 - push.centre) / push.px_per_unit;
    vec3 ray = vec3(PERSPECTIVE ? across : vec2(0.0), 1.0);
    n = dot_of(n, ray) > 0.0 ? -n : n;
    imageStore(facing, pixel, known ? vec4(n, 1.0) : vec4(0.0));
}

void main() {
    EACH_OWN_PIXEL(face)
}
