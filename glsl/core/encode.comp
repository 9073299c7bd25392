// Linear picture -> 8-bit sRGB words or bytes.
//
// A code is the number of thresholds that a channel has reached (src/passes/encode.rs). Floats with
// the same first bits share a bucket with at most one threshold: one load, one comparison, and
// exact.
#version 460
#extension GL_EXT_scalar_block_layout : require

layout(local_size_x = 64) in;

layout(rgba32f) readonly uniform image2D picture;
// Bits of each bucket's threshold, and the code below it.
layout(rgba32ui) readonly uniform uimageBuffer buckets;
layout(scalar) writeonly buffer Screen { uint word[]; } screen;

layout(constant_id = 0) const bool BLUE_FIRST = false;
// True if to write three bytes per pixel, red first, for files; else one word.
layout(constant_id = 1) const bool PACKED = false;
// True if the highest byte of a word is the picture's alpha, which the picture's colours are
// multiplied by and the codes are not; else 255.
layout(constant_id = 2) const bool ALPHA = false;

layout(push_constant, scalar) uniform Push {
    uvec2 size; // pixels of the strip that `screen` holds
    uint top;   // its first row in the picture
} push;

// Sign, exponent and 7 bits: from 2^-13, which is code 0, to 1.
const int FIRST = 0x3900;
const int LAST = 0x3F80;

#include "pixel_index.glsl"

uint code(float linear) {
    int bucket = clamp(floatBitsToInt(linear) >> 16, FIRST, LAST) - FIRST;
    uvec4 found = imageLoad(buckets, bucket);
    uint reached = found.y + (min(linear, 1.0) >= uintBitsToFloat(found.x) ? 1u : 0u);
    // NaN becomes 0.
    return linear > 0.0 ? reached : 0u;
}

uvec4 codes(uvec2 pixel) {
    vec4 linear = imageLoad(picture, ivec2(pixel.x, pixel.y + push.top));
    uint alpha = 255u;
    if (ALPHA) {
        if (!(linear.a > 0.0)) return uvec4(0u);
        linear.rgb /= linear.a;
        alpha = uint(round(255.0 * min(linear.a, 1.0)));
    }
    return uvec4(code(linear.r), code(linear.g), code(linear.b), alpha);
}

void main() {
    if (PACKED) {
        // Four pixels are three words.
        uint four = gl_WorkGroupID.y * gl_NumWorkGroups.x * 64u + gl_GlobalInvocationID.x;
        if (4u * four >= push.size.x * push.size.y) return;
        uvec4 c[4];
        for (uint k = 0u; k < 4u; ++k) c[k] = codes(uvec2(in_rows(4u * four + k, push.size.x)));
        screen.word[3u * four] = c[0].r | c[0].g << 8 | c[0].b << 16 | c[1].r << 24;
        screen.word[3u * four + 1u] = c[1].g | c[1].b << 8 | c[2].r << 16 | c[2].g << 24;
        screen.word[3u * four + 2u] = c[2].b | c[3].r << 8 | c[3].g << 16 | c[3].b << 24;
        return;
    }
    uvec2 pixel = gl_GlobalInvocationID.xy;
    if (pixel.x >= push.size.x || pixel.y >= push.size.y) return;
    uvec4 c = codes(pixel);
    uint low = BLUE_FIRST ? c.b : c.r, high = BLUE_FIRST ? c.r : c.b;
    screen.word[pixel.y * push.size.x + pixel.x] = low | c.g << 8 | high << 16 | c.a << 24;
}
