// Removes invisible pixels from the G-buffer: their depth becomes minus infinity (unknown);
// background is plus infinity.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "tile.glsl"
#include "pixel.glsl"

layout(local_size_x = 64) in;

layout(scalar) readonly buffer Lists { uint word[]; } lists;
layout(scalar) readonly buffer Invisible { uint word[]; } invisible;
layout(r32f) uniform image2D depth;
layout(r32ui) uniform uimage2D index;
layout(rgba32f) uniform image2D color;

// True if to remove index and colour, too, and to mark holes.
layout(constant_id = 0) const bool ALL = true;

layout(push_constant, scalar) uniform Push {
    uint tiles_across;
} push;

void work(uint n) {
    uint tile = lists.word[LIST_HEADER + n];
    uint bits = column_bits(invisible.word[2u * tile], invisible.word[2u * tile + 1u], gl_LocalInvocationID.x % 8u);
    ivec2 pixel = column_of(tile, push.tiles_across);
    [[dont_unroll]] for (int row = 0;; ++row) {
        if ((bits >> row & 1u) == 1u) {
            ivec2 at = pixel + ivec2(0, row);
            // Background has neither index nor colour.
            bool point = floatBitsToUint(imageLoad(depth, at).r) != BACKGROUND_BITS;
            if (ALL || point) imageStore(depth, at, vec4(uintBitsToFloat(UNKNOWN_BITS)));
            if (ALL && point) imageStore(index, at, uvec4(NO_POINT));
            if (ALL && point) imageStore(color, at, vec4(0.0));
        }
        if (row == TILE_PX - 1) break;
    }
}

void main() {
    EACH_OF(lists.word[3u], work)
}
