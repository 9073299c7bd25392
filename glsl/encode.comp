// A linear picture -> its 8-bit sRGB words.
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
    uvec2 size; // pixels
} push;

uint code(float linear) {
    uint reached = 0;
    [[unroll]] for (uint step = 128; step > 0; step /= 2) {
        reached += linear >= thresholds.least[reached + step - 1] ? step : 0;
    }
    return reached;
}

void main() {
    uvec2 pixel = gl_GlobalInvocationID.xy;
    if (pixel.x >= push.size.x || pixel.y >= push.size.y) return;
    vec3 linear = imageLoad(picture, ivec2(pixel)).rgb;
    uint red = code(linear.r), green = code(linear.g), blue = code(linear.b);
    uint low = BLUE_FIRST ? blue : red, high = BLUE_FIRST ? red : blue;
    screen.word[pixel.y * push.size.x + pixel.x] = low | green << 8 | high << 16 | 255u << 24;
}
