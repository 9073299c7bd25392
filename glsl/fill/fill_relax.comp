// Smooths the filled depths of a level of the pyramid: each without a value of its own takes the
// mean of the 3 x 3 around it, weighted by (1 - r / 2) (1 - min(1, |z - z0| / tolerance)) as in
// anisotropic filling (Pintus et al. 2011, sec. 5). With perspective inverse depths are averaged,
// as ratios to the pixel's own.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "pixel.glsl"

layout(local_size_x = 64) in;

// Values of the picture, and of other levels (fill_pull.comp).
layout(r32f) readonly uniform image2D depth;
layout(rgba32f) readonly uniform image2D places;
layout(r32f) readonly uniform image2D from_depth;
layout(r32f) writeonly uniform image2D to_depth;

layout(constant_id = 0) const bool PERSPECTIVE = true;
layout(constant_id = 1) const bool PICTURE = false;

layout(push_constant, scalar) uniform Push {
    uvec2 size;
    float tolerance; // depth difference: metres, or a share of the depth if relative
    uint relative;
} push;

const float OWN_WEIGHT = 0.2;

void main() {
    ivec2 cell = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(cell, ivec2(push.size)))) return;
    float own = PICTURE ? imageLoad(depth, cell).r : imageLoad(places, cell).x;
    float z0 = imageLoad(from_depth, cell).r;
    float z = z0;
    bool has_own = has_depth(floatBitsToUint(own)) && own > 0.0;
    if (!has_own && has_depth(floatBitsToUint(z0))) {
        float tolerance = push.relative == 1u ? push.tolerance * z0 : push.tolerance;
        // Without a tolerance, only equal depths are of one surface.
        float strictness = tolerance > 0.0 ? min(1.0 / tolerance, 3.402823466e38) : 3.402823466e38;
        float weights = OWN_WEIGHT;
        float sum = PERSPECTIVE ? OWN_WEIGHT : 0.0;
        [[unroll]] for (int k = 0; k < 9; ++k) {
            if (k == 4) continue;
            ivec2 at = cell + ivec2(k % 3, k / 3) - 1;
            bool inside = all(greaterThanEqual(at, ivec2(0))) && all(lessThan(at, ivec2(push.size)));
            float found = imageLoad(from_depth, clamp(at, ivec2(0), ivec2(push.size) - 1)).r;
            bool has = inside && has_depth(floatBitsToUint(found));
            float difference = has ? found - z0 : 0.0;
            float near = 1.0 - min(1.0, abs(difference) * strictness);
            float weight = has ? (k % 2 == 0 ? 0.292893219 : 0.5) * near : 0.0;
            weights += weight;
            sum += weight * (PERSPECTIVE ? z0 / (z0 + difference) : difference);
        }
        z = PERSPECTIVE ? z0 / (sum / weights) : z0 + sum / weights;
    }
    imageStore(to_depth, cell, vec4(z));
}
