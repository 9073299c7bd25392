// Blurs colours along one axis by a Gaussian over covered pixels, renormalised (dos Anjos et al.
// 2018, sec. 3.3.3). Runs twice, across and down.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require

layout(local_size_x = 64) in;

layout(rgba32f) readonly uniform image2D color;
layout(rgba32f) writeonly uniform image2D blurred;

layout(push_constant, scalar) uniform Push {
    uvec2 size;       // pixels
    ivec2 along;
    float weights[9]; // of the pixel, and by distance
    int radius_px;
} push;

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    ivec2 size = ivec2(push.size);
    if (pixel.x >= size.x || pixel.y >= size.y) return;
    vec4 own = imageLoad(color, pixel);
    vec4 sum = vec4(0.0);
    float weights = 0.0;
    [[dont_unroll]] for (int k = -push.radius_px; k <= push.radius_px; ++k) {
        ivec2 at = pixel + k * push.along;
        bool within = at.x >= 0 && at.y >= 0 && at.x < size.x && at.y < size.y;
        vec4 other = imageLoad(color, clamp(at, ivec2(0), size - 1));
        float weight = within && other.a > 0.0 ? push.weights[abs(k)] : 0.0;
        sum += other * vec4(weight);
        weights += weight;
    }
    imageStore(blurred, pixel, own.a > 0.0 ? sum / vec4(weights) : own);
}
