// A linear picture -> the 8-bit sRGB words of a screen, which may be larger than the picture.
//
// A code is the number of thresholds that a channel has reached, found by halving: exact, and what a PNG file holds (src/passes/encode.rs).
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require

layout(local_size_x = 64) in;

layout(rgba32f) readonly uniform image2D picture;
layout(scalar) readonly buffer Thresholds { float least[]; } thresholds; // of every code but 0
layout(scalar) writeonly buffer Screen { uint word[]; } screen;

layout(constant_id = 0) const bool BLUE_FIRST = false;

layout(push_constant, scalar) uniform Push {
    uvec2 picture_size; // pixels
    uvec2 screen_size;  // pixels
} push;

uint code(float linear) {
    uint reached = 0;
    [[unroll]] for (uint step = 128; step > 0; step /= 2) {
        reached += linear >= thresholds.least[reached + step - 1] ? step : 0;
    }
    return reached;
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
    uvec2 pixel = gl_GlobalInvocationID.xy;
    if (pixel.x >= push.screen_size.x || pixel.y >= push.screen_size.y) return;
    vec3 linear = push.picture_size == push.screen_size ? at(ivec2(pixel)) : between(pixel);
    uint red = code(linear.r), green = code(linear.g), blue = code(linear.b);
    uint low = BLUE_FIRST ? blue : red, high = BLUE_FIRST ? red : blue;
    screen.word[pixel.y * push.screen_size.x + pixel.x] = low | green << 8 | high << 16 | 255u << 24;
}
