// Depth -> list of the pixels with a point: column, and row in the upper 16 bits; with an indirect
// dispatch of a lane for each. A lane of splat.glsl then has a disc to draw, however few points
// there are. Lists differ from run to run in their order, which no picture depends on.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "pixel.glsl"
#include "tile.glsl"
#include "depth_pyramid.glsl"

layout(local_size_x = 64) in;

layout(r32f) readonly uniform image2D depth;
// Three words of the dispatch, and the number of points. Starts as zeros.
layout(scalar) buffer Counts { uint word[]; } counts;
layout(scalar) writeonly buffer Points { uint pixel[]; } points;

layout(push_constant, scalar) uniform Push {
    uvec2 size; // pixels of the picture
    uint first; // first row
    uint last;  // row behind the last
} push;

void main() {
    int x = int(gl_GlobalInvocationID.x);
    int top = int(push.first) + TILE_PX * int(gl_GlobalInvocationID.y);
    if (x >= int(push.size.x)) return;
    uint found = 0u;
    [[unroll]] for (int row = 0; row < TILE_PX; ++row) {
        float z = imageLoad(depth, ivec2(x, min(top + row, int(push.last) - 1))).r;
        bool has = top + row < int(push.last) && z > 0.0 && !isinf(z);
        found |= has ? 1u << row : 0u;
    }
    if (found == 0u) return;
    uint place = 0u;
    LEAVE(counts, 0, uint(bitCount(found)), place)
    for (; found != 0u; found &= found - 1u) {
        points.pixel[place] = uint(x) | uint(top + findLSB(found)) << 16;
        place += 1u;
    }
}
