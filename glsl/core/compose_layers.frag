// Point ids and normals of a finished picture -> a host's images.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "host_depth.glsl"

layout(set = 1, r32ui) readonly uniform uimage2D index;
layout(set = 1, rgba32f) readonly uniform image2D normal;
layout(set = 1, r32f) readonly uniform image2D depth;

// True if normals may be longer than 1.
layout(constant_id = 2) const bool DISTORTED = false;

layout(push_constant, scalar) uniform Push {
    ivec2 corner; // of the picture in the target [px]
    vec2 form;    // a and b
    float far;    // the host's depth of what is infinitely far
    uint cloud;   // id of the cloud
    vec3 x;       // axes of the cloud in the host's world
    vec3 y;
    vec3 z;
} push;

layout(location = 0) out uvec2 id;
layout(location = 1) out vec4 direction;

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy) - push.corner;
    float z = imageLoad(depth, pixel).r;
    if (!is_known(z)) discard;
    id = uvec2(imageLoad(index, pixel).r, push.cloud);
    vec3 n = imageLoad(normal, pixel).xyz;
    vec3 world = push.x * n.x + push.y * n.y + push.z * n.z;
    direction = vec4(DISTORTED && world != vec3(0.0) ? normalize(world) : world, 0.0);
    if (DEPTH != 0) gl_FragDepth = host_depth(z, push.form, push.far);
}
