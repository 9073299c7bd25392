// Normals -> tangents of strokes (dos Anjos et al. 2018, sec. 3.3.1), as stroke_bins computes them:
// for the study that times them and the test against their f64 twin.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require

#include "exact_dot.glsl"
#include "stroke_tangent.glsl"

layout(local_size_x = 64) in;

// A unit normal; cosine and sine of the angle from its own tangent to the direction in which its
// neighbours spread most.
struct Direction {
    vec3 normal;
    vec2 turn;
};

layout(scalar) readonly buffer Directions { Direction direction[]; } directions;
layout(scalar) writeonly buffer Tangents { vec3 tangent[]; } tangents;

layout(push_constant, scalar) uniform Push {
    uint count;
    uint way;
} push;

void main() {
    uint i = gl_GlobalInvocationID.y * gl_NumWorkGroups.x * 64u + gl_GlobalInvocationID.x;
    if (i >= push.count) return;
    vec3 normal = directions.direction[i].normal;
    tangents.tangent[i] = push.way == COVARIANCE ? turned(normal, directions.direction[i].turn) : tangent_of(push.way, normal);
}
