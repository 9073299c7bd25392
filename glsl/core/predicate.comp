// Count, workgroups -> the same workgroups if the count is not 0, else none.
#version 460
#extension GL_EXT_scalar_block_layout : require

layout(local_size_x = 64) in;

layout(scalar) readonly buffer Count { uint count[]; } count;
layout(scalar) readonly buffer Wanted { uint word[]; } wanted;
layout(scalar) writeonly buffer Groups { uint word[]; } groups;

layout(push_constant, scalar) uniform Push {
    uint words;
} push;

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= push.words) return;
    groups.word[i] = count.count[0] > 0u ? wanted.word[i] : 0u;
}
