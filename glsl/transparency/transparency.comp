// A layer, and those in front of it -> all of them composited front to back in linear light, and
// the depth behind which the next one is looked for (Dobrev et al. 2010, sec. 4 and 5).
//
//     front <- front + (1 - front.a) layer          premultiplied
//
//     no point, or less than 2^-9 of the light is left    infinite depth: nothing more is looked for
//     else                                                depth of the layer + layer distance, or the
//                                                         depth of its slope within a pixel over the
//                                                         distance its depth was carried
// and never less than before, since depths may have been filled. A point must lie deeper than that,
// so every layer is deeper than the one before, even if the distance is below a quantum of the
// depth (guide: numerics, case 15).
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require

const bool BEHIND = true;

#include "tile.glsl"
#include "tile_mask.glsl"
#include "keys.glsl"
#include "depth_source.glsl"

layout(local_size_x = 64) in;

layout(rgba32f) readonly uniform image2D color;
layout(r32f) readonly uniform image2D shading;
// Depth of the layer as shown, and as projected.
layout(r32f) readonly uniform image2D depth;
layout(r32f) readonly uniform image2D projected_depth;
// Source of each pixel's depth (depth_source.glsl), four rows per texel; unread if each is its own.
layout(rgba32f) readonly uniform image2D source;
// Planar depth of a host's geometry, infinite where nothing is; unread without.
layout(r32f) readonly uniform image2D occluder;
// Composite of the layers in front: the same image as the one below; unread for the first.
layout(rgba32f) readonly uniform image2D front_before;
layout(rgba32f) writeonly uniform image2D front;
// Keys of this layer, and in the same buffer those of the next (keys.glsl); as texels, and as words
// if texel buffers are too small.
layout(r32ui) readonly uniform uimageBuffer keys;
layout(scalar) readonly buffer KeyWords { uint word[]; } key_words;
layout(scalar) writeonly buffer Next { uint word[]; } next;
// 0 only if no pixel is left.
layout(scalar) buffer Left { uint any[]; } left;
// The same as a texel.
layout(r32ui) readonly uniform uimageBuffer any_left;

layout(constant_id = 0) const bool HAS_SHADING = false;
// First layer: all in front is 0. Last layer: nothing behind is looked for.
layout(constant_id = 1) const bool FIRST = false;
layout(constant_id = 2) const bool LAST = false;
layout(constant_id = 3) const bool TEXELS = true;
// True if depths were taken from other pixels.
layout(constant_id = 4) const bool TAKEN = false;
// True if a host's geometry hides what is behind it.
layout(constant_id = 5) const bool OCCLUDED = false;

layout(push_constant, scalar) uniform Push {
    uvec2 size;    // pixels of this strip
    uint top;      // first row of this strip in the picture
    float layer;   // metres
    float slant;   // factor on the depth of a surface within a pixel
    float uphill;  // and for each pixel that its depth was carried
    float carried; // pixels, if the source is unknown
    int apart_px;  // distance of pixels with depths of different points [px]
} push;

const uint NO_POINT = 0xFFFFFFFFu;
const uint INFINITY_BITS = 0x7F800000u;
const float FARTHEST = 3.402823466e38;
const float LEAST_LIGHT = 1.0 / 512.0;

// Returns how far a surface falls to an adjacent pixel along an axis, on the flatter side, since it
// may end on the other.
float fall(float z, ivec2 pixel, ivec2 aside) {
    float before = imageLoad(depth, pixel - aside).r;
    float after = imageLoad(depth, pixel + aside).r;
    // Pixels outside read 0, and unknown depths are negative: no depths.
    float back = before > 0.0 ? abs(before - z) : FARTHEST;
    float ahead = after > 0.0 ? abs(after - z) : FARTHEST;
    float least = min(back, ahead);
    return least < FARTHEST ? least : 0.0;
}

void add(ivec2 at) {
    // Listed pixels are those of the whole picture.
    if (LISTED) at.y -= int(push.top);
    if (at.y < 0 || any(greaterThanEqual(at, ivec2(push.size)))) return;
    ivec2 pixel = ivec2(at.x, at.y + int(push.top));
    vec4 c = imageLoad(color, pixel);
    if (HAS_SHADING) c.rgb *= imageLoad(shading, pixel).r;
    vec4 sum = FIRST ? vec4(0.0) : imageLoad(front_before, pixel);
    float shown = imageLoad(depth, pixel).r;
    // Loads are outside of conditions: in a branch lavapipe loads lane by lane.
    float projected = imageLoad(projected_depth, pixel).r;
    // Unknown pixels count as behind the point that was there.
    uint bits = floatBitsToUint(mix(projected, shown, shown > 0.0));
    bool hidden = OCCLUDED && uintBitsToFloat(bits) > imageLoad(occluder, pixel).r;
    if (!hidden) sum += c * (1.0 - sum.a);
    imageStore(front, pixel, sum);

    bool goes_on = bits < INFINITY_BITS && !hidden && 1.0 - sum.a >= LEAST_LIGHT;
    // One write is enough: an atomic per pixel would dominate this pass.
    bool is_first = imageLoad(any_left, 0).r == 0u;
    if (goes_on && is_first) atomicOr(left.any[0], 1u);
    if (LAST) return;
    float z = uintBitsToFloat(goes_on ? bits : 0u);
    float slope = (fall(z, pixel, ivec2(push.apart_px, 0)) + fall(z, pixel, ivec2(0, push.apart_px))) / float(push.apart_px);
    ivec2 way = abs(way_to(imageLoad(source, ivec2(pixel.x, pixel.y / 4))[pixel.y & 3]));
    float carried = TAKEN ? float(max(way.x, way.y)) : push.carried;
    float layer = max(push.layer, (push.slant + push.uphill * carried) * slope);
    uint k = uint(at.y) * push.size.x + uint(at.x);
    // Positive floats order like their bits.
    uint least = FIRST ? 0u : TEXELS ? imageLoad(keys, int(WORDS_A_KEY * k)).r : key_words.word[WORDS_A_KEY * k];
    next.word[WORDS_A_KEY * k] = max(least, goes_on ? floatBitsToUint(z + layer) : INFINITY_BITS);
    next.word[point_word(k)] = NO_POINT;
    next.word[depth_word(k)] = NO_POINT;
}

void main() {
    EACH_OWN_PIXEL(add)
}
