// A deeper level of shape depiction (lib/shape.glsl) on listed tiles: depth of level k -> its share
// of the shade, and the depth of level k + 1. Images have four rows per texel.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "pixel.glsl"
#include "neighborhood.glsl"
#include "shape.glsl"
#include "tile.glsl"

layout(local_size_x = 64) in;

layout(rgba32f) readonly uniform image2D from;
layout(rgba32f) writeonly uniform image2D to;
layout(rgba32f) uniform image2D shade;
layout(scalar) readonly buffer Lists { uint word[]; } lists;
layout(r32ui) readonly uniform uimageBuffer listed_words;
layout(scalar) readonly buffer Wanted { uint word[]; } wanted;
layout(r32ui) readonly uniform uimageBuffer wanted_words;

layout(constant_id = 0) const bool PERSPECTIVE = true;
layout(constant_id = 1) const bool TEXELS = true;

layout(push_constant, scalar) uniform Push {
    uint tiles_across;
    float width;  // width of `softness` pixels: metres, or a share of the depth with perspective
    float before; // weight of what the shade holds
    float weight; // of this level
} push;

void work(uint n) {
    uint tile = WORD(listed_words, lists, LIST_HEADER + n);
    ivec2 top = column_of(tile, push.tiles_across);
    bool shaded = (WORD(wanted_words, wanted, tile) & 2u) != 0u;
    [[dont_unroll]] for (int half_tile = 0;; ++half_tile) {
        ivec2 texel = ivec2(top.x, top.y / 4 + half_tile);
        float z[18];
        LOAD_AROUND(z, from, texel)
        vec4 omegas;
        vec4 nexts;
        [[unroll]] for (int p = 0; p < 4; ++p) {
            float around[9];
            [[unroll]] for (int k = 0; k < 9; ++k) around[k] = z[3 * p + k];
            Level level = level_of(around, push.width, PERSPECTIVE);
            omegas[p] = level.omega;
            nexts[p] = level.next;
        }
        vec4 sum = imageLoad(shade, texel) * push.before + omegas * push.weight;
        if (shaded) imageStore(shade, texel, sum);
        imageStore(to, texel, nexts);
        if (half_tile == 1) break;
    }
}

void main() {
    EACH_OF(WORD(listed_words, lists, 3u), work)
}
