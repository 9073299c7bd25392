// Points and the front depth -> sums of the pixels' values, of all points at most epsilon behind the front (Kanzok, Linsen and Rosenthal 2012, sec. 5).
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#extension GL_EXT_shader_atomic_int64 : require
#extension GL_GOOGLE_include_directive : require

#define MORE_TO_PUSH float epsilon; uint top; float lo; float scale;
#define WITH_WORDS

#include "point_constants.glsl"
#include "drawn_node.glsl"

// 1: V of HSV; 3: red, green and blue.
layout(constant_id = 5) const uint CHANNELS = 1u;
// Points show a number on a grey ramp.
layout(constant_id = 7) const bool RAMP = false;

layout(scalar) readonly buffer Nodes { Node node[]; } nodes;
// Factors that make up a point's opacity.
layout(scalar) readonly buffer Opacities { float factor[]; } opacities;
// What lies in clip boxes, of nodes that have points on both sides.
layout(scalar) readonly buffer Boxes { Within cells[]; } within;
layout(scalar) readonly buffer Chunks { uint chunk[]; } chunks;
// Of every listed chunk, whether it has a point near the front.
layout(scalar) readonly buffer Shallow { uint chunk[]; } shallow;
// The pages of one block, twice: as texels in fours, and for devices whose texel buffers are too small as a storage buffer.
layout(rgba32ui) readonly uniform uimageBuffer pages;
layout(scalar) readonly buffer PageWords { uvec4 four[]; } page_words;
// Of the whole picture, the depth of the nearest points.
layout(r32f) readonly uniform image2D front;
layout(r32ui) readonly uniform uimageBuffer levels;
layout(scalar) buffer Sums { uint64_t sum[]; } sums;

#include "project.glsl"

void add_to(uint at, uint value, uint count) {
    atomicAdd(sums.sum[at], uint64_t(count) << 36 | uint64_t(value));
}

#include "luminance_sum.glsl"
#include "point_loop.glsl"
