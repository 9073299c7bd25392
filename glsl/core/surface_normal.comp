// Depth -> world normals of the surface, towards the camera; zero without a surface or a neighbour.
//
// The neighbour along each axis whose depth is nearer to the pixel's own is used, so that an edge
// belongs to the surface that ends there. Both give the same normal on a plane.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require

#include "pixel.glsl"

layout(local_size_x = 64) in;

layout(r32f) readonly uniform image2D depth;
layout(rgba32f) writeonly uniform image2D normal;

layout(constant_id = 0) const bool PERSPECTIVE = true;

layout(push_constant, scalar) uniform Push {
    uvec2 size;        // pixels
    vec2 centre;       // principal point [px]
    float px_per_unit; // perspective: focal length in pixels; orthographic: pixels per metre
    vec3 right;        // the camera's axes in the world
    vec3 up;
    vec3 forward;
} push;

// Returns the place: right, down and away from the camera.
vec3 place(ivec2 pixel, float z) {
    vec2 aside = (vec2(pixel) + 0.5 - push.centre) / push.px_per_unit;
    vec2 across = PERSPECTIVE ? aside * z : aside;
    return vec3(across, z);
}

// Returns the vector to the nearer neighbour along an axis, in the positive direction; zero without
// one.
vec3 along(ivec2 pixel, float z, ivec2 axis) {
    float before = imageLoad(depth, pixel - axis).r;
    float after = imageLoad(depth, pixel + axis).r;
    bool has_before = has_depth(floatBitsToUint(before)) && before > 0.0;
    bool has_after = has_depth(floatBitsToUint(after)) && after > 0.0;
    vec3 own = place(pixel, z);
    bool forwards = has_after && (!has_before || abs(after - z) <= abs(before - z));
    vec3 step = forwards ? place(pixel + axis, after) - own : has_before ? own - place(pixel - axis, before) : vec3(0.0);
    return step;
}

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, ivec2(push.size)))) return;
    float z = imageLoad(depth, pixel).r;
    vec3 n = vec3(0.0);
    if (has_depth(floatBitsToUint(z)) && z > 0.0) {
        vec3 a = along(pixel, z, ivec2(1, 0)) / z;
        vec3 b = along(pixel, z, ivec2(0, 1)) / z;
        // Right x down points away from the camera.
        vec3 c = -vec3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
        float square = c.x * c.x + c.y * c.y + c.z * c.z;
        n = square > 0.0 ? c / sqrt(square) : vec3(0.0);
    }
    vec3 world = push.right * n.x - push.up * n.y + push.forward * n.z;
    imageStore(normal, pixel, vec4(world, 0.0));
}
