// The sums of luminance_sum64.comp on devices without 64-bit atomics: the lower word tells when it
// overflows, and the upper one takes the carry.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require

#define MORE_TO_PUSH float epsilon; uint top; float lo; float scale;
#define WITH_WORDS

#include "point_constants.glsl"
#include "drawn_node.glsl"

// 1: V of HSV; 3: red, green and blue.
layout(constant_id = 5) const uint CHANNELS = 1u;
// True if points show a number on a grey ramp.
layout(constant_id = 7) const bool RAMP = false;

layout(scalar) readonly buffer Nodes { Node node[]; } nodes;
// Factors of opacity (lib/point_kind.glsl).
layout(scalar) readonly buffer Opacities { float factor[]; } opacities;
// Clip boxes of nodes with points on both sides.
layout(scalar) readonly buffer Boxes { Within cells[]; } within;
layout(scalar) readonly buffer Chunks { uint chunk[]; } chunks;
// True if each listed chunk has a point near the front.
layout(scalar) readonly buffer Shallow { uint chunk[]; } shallow;
// Pages of a block, as texels of four words; and as words if texel buffers are too small.
layout(rgba32ui) readonly uniform uimageBuffer pages;
layout(scalar) readonly buffer PageWords { uvec4 four[]; } page_words;
// Depth of the nearest points, for the whole picture.
layout(r32f) readonly uniform image2D front;
layout(r32ui) readonly uniform uimageBuffer levels;
layout(scalar) buffer Sums { uint word[]; } sums;

#include "project.glsl"

void add_to(uint at, uint value, uint count) {
    uint before = atomicAdd(sums.word[2u * at], value);
    uint carry = uint(before + value < before);
    atomicAdd(sums.word[2u * at + 1u], (count << 4) + carry);
}

#include "luminance_sum.glsl"
#include "point_loop.glsl"
