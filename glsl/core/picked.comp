// Ids in some pixels -> the words of their points. Pixels without a point are left out.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_buffer_reference_uvec2 : require
#extension GL_GOOGLE_include_directive : require

#include "drawn_node.glsl"

layout(local_size_x = 64) in;

layout(r32ui) readonly uniform uimage2D index;
layout(scalar) readonly buffer Pixels { uvec2 at[]; } pixels;
// Address of each node's first page, two words, and how many pages follow one another there.
layout(scalar) readonly buffer Homes { uvec3 home[]; } homes;
layout(scalar) writeonly buffer Picked { uint word[]; } picked;

layout(buffer_reference, scalar, buffer_reference_align = 4) readonly buffer Pages { uint word[]; };

layout(push_constant, scalar) uniform Push {
    uint count; // pixels
    uint words; // room for each
} push;

const uint NO_POINT = 0xFFFFFFFFu;

void main() {
    uint own = gl_GlobalInvocationID.x;
    if (own >= push.count) return;
    uint id = imageLoad(index, ivec2(pixels.at[own])).r;
    if (id == NO_POINT) return;
    uvec3 home = homes.home[id >> POINTS_PER_PAGE_LOG2];
    for (uint page = 0u; page < home.z; ++page) {
        uint word = Pages(home.xy).word[(page << POINTS_PER_PAGE_LOG2) + (id & (POINTS_PER_PAGE - 1u))];
        picked.word[own * push.words + page] = word;
    }
}
