// Corners of a triangle, in clip space.
#version 460
#extension GL_EXT_scalar_block_layout : require

layout(push_constant, scalar) uniform Push {
    vec4 x, y, z, w; // columns of the matrix from the world to clip space
} push;

void main() {
    vec3 corner = gl_VertexIndex == 0 ? vec3(-1.2, 0.0, -1.0) : gl_VertexIndex == 1 ? vec3(1.2, 0.0, -1.0) : vec3(0.0, 0.0, 1.2);
    gl_Position = mat4(push.x, push.y, push.z, push.w) * vec4(corner, 1.0);
}
