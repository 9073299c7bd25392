// A linear picture -> the 8-bit sRGB words of a screen, which may be larger than the picture.
//
// A code is the number of thresholds that a channel has reached (src/passes/encode.rs). Floats whose bits begin alike share a bucket, which holds one threshold at most: one look, one comparison, and exact.
#version 460
#extension GL_EXT_scalar_block_layout : require

layout(local_size_x = 64) in;

layout(rgba32f) readonly uniform image2D picture;
// Of every bucket, the bits of its threshold, and the code of what does not reach it.
layout(rgba32ui) readonly uniform uimageBuffer buckets;
layout(scalar) writeonly buffer Screen { uint word[]; } screen;

layout(constant_id = 0) const bool BLUE_FIRST = false;

layout(push_constant, scalar) uniform Push {
    uvec2 picture_size; // pixels
    uvec2 screen_size;  // pixels
    uint top;           // the first row of the screen that `screen` holds
    uint rows;          // that it holds
} push;

// Of a sign, an exponent and 7 bits: from 2^-13, which is code 0, to 1.
const int FIRST = 0x3900;
const int LAST = 0x3F80;

uint code(float linear) {
    int bucket = clamp(floatBitsToInt(linear) >> 16, FIRST, LAST) - FIRST;
    uvec4 found = imageLoad(buckets, bucket);
    uint reached = found.y + (min(linear, 1.0) >= uintBitsToFloat(found.x) ? 1u : 0u);
    // NaN is nothing.
    return linear > 0.0 ? reached : 0u;
}

vec3 at(ivec2 pixel) {
    return imageLoad(picture, clamp(pixel, ivec2(0), ivec2(push.picture_size) - 1)).rgb;
}

// Between the centres of four pixels; on a centre, its pixel alone.
vec3 between(uvec2 pixel) {
    vec2 place = (vec2(pixel) + 0.5) * vec2(push.picture_size) / vec2(push.screen_size) - 0.5;
    ivec2 first = ivec2(floor(place));
    vec2 share = place - vec2(first);
    vec3 above = at(first) * (1.0 - share.x) + at(first + ivec2(1, 0)) * share.x;
    vec3 below = at(first + ivec2(0, 1)) * (1.0 - share.x) + at(first + ivec2(1, 1)) * share.x;
    return above * (1.0 - share.y) + below * share.y;
}

void main() {
    uvec2 own = gl_GlobalInvocationID.xy;
    if (own.x >= push.screen_size.x || own.y >= push.rows) return;
    uvec2 pixel = uvec2(own.x, own.y + push.top);
    vec3 linear = push.picture_size == push.screen_size ? at(ivec2(pixel)) : between(pixel);
    uint red = code(linear.r), green = code(linear.g), blue = code(linear.b);
    uint low = BLUE_FIRST ? blue : red, high = BLUE_FIRST ? red : blue;
    screen.word[own.y * push.screen_size.x + own.x] = low | green << 8 | high << 16 | 255u << 24;
}
