// The papers' way of drawing points: one vertex per point, with f32 positions relative to the
// cloud's centre.
#version 460
#extension GL_EXT_scalar_block_layout : require

layout(location = 0) in vec3 position;
layout(location = 0) flat out uint point;

layout(push_constant, scalar) uniform Push {
    vec4 row_x; // clip space
    vec4 row_y;
    vec4 row_w;
    float near;
} push;

void main() {
    vec4 p = vec4(position, 1.0);
    gl_Position = vec4(dot(push.row_x, p), dot(push.row_y, p), push.near, dot(push.row_w, p));
    gl_PointSize = 1.0;
    point = gl_VertexIndex;
}
