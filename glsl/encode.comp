// A linear picture -> its 8-bit sRGB words.
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
    uvec2 size; // pixels of the band that `screen` holds
    uint top;   // its first row in the picture
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

void main() {
    uvec2 pixel = gl_GlobalInvocationID.xy;
    if (pixel.x >= push.size.x || pixel.y >= push.size.y) return;
    vec3 linear = imageLoad(picture, ivec2(pixel.x, pixel.y + push.top)).rgb;
    uint red = code(linear.r), green = code(linear.g), blue = code(linear.b);
    uint low = BLUE_FIRST ? blue : red, high = BLUE_FIRST ? red : blue;
    screen.word[pixel.y * push.size.x + pixel.x] = low | green << 8 | high << 16 | 255u << 24;
}
