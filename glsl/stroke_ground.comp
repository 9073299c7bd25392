// Keys where a surface is; none elsewhere.
#version 460
#extension GL_EXT_scalar_block_layout : require

layout(local_size_x = 64) in;

layout(scalar) readonly buffer Ground { uint word[]; } ground;
layout(scalar) buffer Keys { uvec2 key[]; } keys;

layout(push_constant, scalar) uniform Push { uint pixels; } push;

void main() {
    uint pixel = (gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x) * 64u + gl_LocalInvocationID.x;
    if (pixel < push.pixels && ground.word[pixel] == 0u) keys.key[pixel] = uvec2(0xFFFFFFFFu);
}
