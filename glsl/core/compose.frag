// A finished picture and its depth -> colour and depth of a host's images.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "host_depth.glsl"

layout(set = 1, rgba32f) readonly uniform image2D picture;
layout(set = 1, r32f) readonly uniform image2D depth;
// As in encode.comp; the linear colours of the code below and of the next one follow.
layout(set = 1, rgba32ui) readonly uniform uimageBuffer buckets;

// 0: linear. 1: 8-bit codes. 2: linear colours of 8-bit codes, which the device encodes again. 3:
// sRGB of more than 8 bits.
layout(constant_id = 0) const uint ENCODING = 0;
// True if the picture has a background of its own.
layout(constant_id = 2) const bool OPAQUE = false;

layout(push_constant, scalar) uniform Push {
    ivec2 corner; // of the picture in the target [px]
    vec2 form;    // a and b
    float far;    // the host's depth of what is infinitely far
} push;

layout(location = 0) out vec4 color;

// As in encode.comp.
const int FIRST = 0x3900;
const int LAST = 0x3F80;

float code(float linear) {
    int bucket = clamp(floatBitsToInt(linear) >> 16, FIRST, LAST) - FIRST;
    uvec4 found = imageLoad(buckets, bucket);
    bool reached = linear > 0.0 && min(linear, 1.0) >= uintBitsToFloat(found.x);
    if (ENCODING == 2) return uintBitsToFloat(reached ? found.w : linear > 0.0 ? found.z : 0u);
    return (linear > 0.0 ? float(found.y) + (reached ? 1.0 : 0.0) : 0.0) / 255.0;
}

float curve(float linear) {
    float c = clamp(linear, 0.0, 1.0);
    return c <= 0.0031308 ? 12.92 * c : 1.055 * pow(c, 1.0 / 2.4) - 0.055;
}

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy) - push.corner;
    vec4 c = imageLoad(picture, pixel);
    if (c.a <= 0.0) discard;
    float alpha = OPAQUE ? 1.0 : c.a;
    vec3 linear = c.rgb / alpha;
    vec3 encoded = linear;
    if (ENCODING == 1 || ENCODING == 2) encoded = vec3(code(linear.r), code(linear.g), code(linear.b));
    if (ENCODING == 3) encoded = vec3(curve(linear.r), curve(linear.g), curve(linear.b));
    color = vec4(encoded * alpha, alpha);
    if (DEPTH != 0) gl_FragDepth = host_depth(imageLoad(depth, pixel).r, push.form, push.far);
}
