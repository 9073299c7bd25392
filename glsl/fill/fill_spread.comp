// How far depths of a level of the pyramid lie from what they would be without a value of their own
// -> the same for all cells: those without a value take the mean of their neighbours' (see
// fill_correct.comp).
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "pixel.glsl"

layout(local_size_x = 64) in;

layout(r32f) readonly uniform image2D filled_depth;
// See fill_push.comp.
layout(r32f) readonly uniform image2D missed;
// 0 for cells that know nothing.
layout(r32f) writeonly uniform image2D correction;

layout(push_constant, scalar) uniform Push {
    uvec2 size;
    float tolerance; // depth difference: metres, or a share of the depth if relative
    uint relative;
} push;

void main() {
    ivec2 cell = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(cell, ivec2(push.size)))) return;
    float z = imageLoad(filled_depth, cell).r;
    float by = imageLoad(missed, cell).r;
    bool known = has_depth(floatBitsToUint(by)) || by == 0.0;
    by = known ? by : 0.0;
    if (!known && has_depth(floatBitsToUint(z))) {
        float tolerance = push.relative == 1u ? push.tolerance * z : push.tolerance;
        float weights = 0.0;
        float sum = 0.0;
        [[unroll]] for (int k = 0; k < 9; ++k) {
            if (k == 4) continue;
            ivec2 at = cell + ivec2(k % 3, k / 3) - 1;
            bool inside = all(greaterThanEqual(at, ivec2(0))) && all(lessThan(at, ivec2(push.size)));
            ivec2 clamped = clamp(at, ivec2(0), ivec2(push.size) - 1);
            float theirs = imageLoad(missed, clamped).r;
            bool has = inside && (has_depth(floatBitsToUint(theirs)) || theirs == 0.0);
            float difference = has ? imageLoad(filled_depth, clamped).r - z : 0.0;
            float weight = has ? anisotropic_weight(k, difference, tolerance) : 0.0;
            weights += weight;
            sum += weight > 0.0 ? weight * theirs : 0.0;
        }
        by = weights > 0.0 ? sum / weights : 0.0;
    }
    imageStore(correction, cell, vec4(by));
}
