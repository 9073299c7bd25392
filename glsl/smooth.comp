// Smoothing (Dobrev et al. 2010, sec. 3.4; papers/README.md): depth and colour -> where something was filled in the 3 x 3, the weighted mean of those in it that have a depth.
//
//   alleviated Gaussian   1  2  1     Gaussian   1  2  1     box   1  1  1
//                         2 16  2                2  4  2           1  1  1
//                         1  2  1                1  2  1           1  1  1
// Weights are whole numbers, divided by the sum of those that counted. Means are of differences to the pixel's own value: what is constant stays as it is, to the last bit (HARD_CASES 26). Background
// neither gives nor takes. What was measured stays as it is where all around it was, unless all is asked for.
//
// It runs over all tiles: of a list of those with filled pixels lavapipe took more than twice as long a pixel, column by column, and copied what had changed back.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "pixel.glsl"
#include "tile.glsl"
#include "area.glsl"

layout(local_size_x = 64) in;

// Depths as points were projected, and as filling left them: not the same where pixels were filled.
layout(r32f) readonly uniform image2D raw;
layout(r32f) readonly uniform image2D filled;
layout(r32f) readonly uniform image2D depth;
layout(rgba32f) readonly uniform image2D color;
layout(r32f) writeonly uniform image2D smooth_depth;
layout(rgba32f) writeonly uniform image2D smooth_color;

// It has been smoothed before: `depth` is no longer what filling left.
layout(constant_id = 1) const bool AGAIN = false;
// Also where nothing was filled.
layout(constant_id = 0) const bool ALL = false;

layout(push_constant, scalar) uniform Push {
    uvec2 size; // pixels
    vec3 weights; // of the pixel itself, of those beside, above and below it, and of those at its corners
} push;

// A power of two that keeps sums finite, and its inverse.
const float SMALL = 0.015625;
const float LARGE = 64.0;

bool known(float z) {
    return has_depth(floatBitsToUint(z)) && z > 0.0;
}

// By the depth that is there now.
bool is_filled(ivec2 pixel, float z) {
    return floatBitsToUint(imageLoad(raw, pixel).r) != floatBitsToUint(AGAIN ? imageLoad(filled, pixel).r : z);
}

void smoothen(ivec2 pixel) {
    if (any(greaterThanEqual(pixel, ivec2(push.size)))) return;
    float z0 = imageLoad(depth, pixel).r;
    vec4 c0 = imageLoad(color, pixel);
    bool has = known(z0);
    bool blends = ALL || is_filled(pixel, z0);
    float weights = push.weights.x;
    float rise = 0.0;
    vec3 change = vec3(0.0);
    [[unroll]] for (int k = 0; k < 8; ++k) {
        ivec2 aside = ivec2((k + k / 4) % 3 - 1, (k + k / 4) / 3 - 1);
        float z = imageLoad(depth, pixel + aside).r;
        vec3 c = imageLoad(color, pixel + aside).rgb;
        if (!ALL) blends = blends || is_filled(pixel + aside, z);
        bool counts = has && known(z);
        float weight = mix(0.0, abs(aside.x) + abs(aside.y) == 1 ? push.weights.y : push.weights.z, counts);
        weights += weight;
        // Where it does not count, the difference may be one of infinities; and where it is of the farthest depths, it must not grow into one.
        rise += weight * mix(0.0, (z - z0) * SMALL, counts);
        change += vec3(weight) * (c - c0.rgb);
    }
    float share = mix(0.0, 1.0 / weights, blends);
    imageStore(smooth_depth, pixel, vec4(mix(z0, z0 + rise * share * LARGE, has && blends)));
    imageStore(smooth_color, pixel, vec4(c0.rgb + change * vec3(share), c0.a));
}

void main() {
    EACH_OWN_PIXEL(smoothen)
}
