// One level of shape depiction (Pintus et al. 2011, sec. 6, eq. 2 and 3; papers/README.md): depth of level k in; its share of the shade added; depth of level k + 1 out.
//
//   mu, sigma = mean and standard deviation of the depths in the 3 x 3         of differences to the centre: exact beside it
//   dmin = mu - sigma, dmax = mu + sigma
//   omega = clamp(1 - |d - dmin| / (dmax - dmin + eps), 0, 1)
//   next d = (mu + dmin) / 2 = mu - sigma / 2
// eps is `softness` pixels' width: a surface that rises by less than that from pixel to pixel faces the viewer and is bright, a steeper one darkens towards a half.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "pixel.glsl"

layout(local_size_x = 64) in;

layout(r32f) readonly uniform image2D depth;
layout(r32f) readonly uniform image2D shade_before;
layout(r32f) writeonly uniform image2D next;
layout(r32f) writeonly uniform image2D shade;

layout(constant_id = 0) const bool PERSPECTIVE = true;
layout(constant_id = 1) const bool FIRST = true;

layout(push_constant, scalar) uniform Push {
    uvec2 size;        // pixels
    float width;       // of `softness` pixels: metres, or with perspective parts of the depth
    float weight;      // of this level; all levels' weights add up to 1
} push;

void main() {
    ivec2 size = ivec2(push.size);
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (pixel.x >= size.x || pixel.y >= size.y) return;
    float z = imageLoad(depth, pixel).r;
    bool point = has_depth(floatBitsToUint(z)) && z > 0.0;
    float z0 = point ? z : 1.0;
    float rise[9];
    precise float count = 0.0;
    precise float sum = 0.0;
    [[unroll]] for (int k = 0; k < 9; ++k) {
        ivec2 q = pixel + ivec2(k % 3, k / 3) - 1;
        bool there = q.x >= 0 && q.y >= 0 && q.x < size.x && q.y < size.y;
        float zk = imageLoad(depth, clamp(q, ivec2(0), size - 1)).r;
        bool has = there && zk > 0.0 && zk < uintBitsToFloat(BACKGROUND_BITS);
        rise[k] = has ? zk - z0 : 0.0;
        // Marks a neighbour that is not there.
        rise[k] = has ? rise[k] : uintBitsToFloat(BACKGROUND_BITS);
        count += has ? 1.0 : 0.0;
        sum += has ? rise[k] : 0.0;
    }
    precise float mu = sum / max(count, 1.0);
    precise float squares = 0.0;
    [[unroll]] for (int k = 0; k < 9; ++k) {
        bool has = rise[k] < uintBitsToFloat(BACKGROUND_BITS);
        precise float off = has ? rise[k] - mu : 0.0;
        squares += off * off;
    }
    precise float sigma = sqrt(squares / max(count, 1.0));
    precise float eps = max(PERSPECTIVE ? push.width * z0 : push.width, z0 * 9.5367431640625e-7);
    // d = z0 is 0 here.
    precise float omega = clamp(1.0 - abs(sigma - mu) / (2.0 * sigma + eps), 0.0, 1.0);
    precise float lower = z0 + (mu - 0.5 * sigma);
    imageStore(next, pixel, vec4(point ? max(lower, z0 * 0.5) : z));
    precise float sum_of_levels = (FIRST ? 0.0 : imageLoad(shade_before, pixel).r) + push.weight * omega;
    imageStore(shade, pixel, vec4(sum_of_levels));
}
