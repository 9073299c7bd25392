// Corrects the filled depths of a level of the pyramid by what the coarser level has missed. Means
// of coarse cells lie beside a surface that bends, and adjacent cells by nearly the same distance.
// So cells without a value are moved by what their neighbours with a value differ from their own
// prediction (defect correction, as in multigrid methods; Brandt 1977, sec. 2). The mean over 3 x 3
// cells leaves no steps where corrections end.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "pixel.glsl"

layout(local_size_x = 64) in;

layout(r32f) readonly uniform image2D filled_depth;
// None for cells without a value of their own (fill_push.comp).
layout(r32f) readonly uniform image2D missed;
layout(r32f) readonly uniform image2D correction;
layout(r32f) writeonly uniform image2D corrected_depth;

layout(constant_id = 0) const bool PERSPECTIVE = true;

layout(push_constant, scalar) uniform Push {
    uvec2 size;
    float tolerance; // depth difference: metres, or a share of the depth if relative
    uint relative;
} push;

const float OWN_WEIGHT = 0.2;

void main() {
    ivec2 cell = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(cell, ivec2(push.size)))) return;
    float z = imageLoad(filled_depth, cell).r;
    bool filled = floatBitsToUint(imageLoad(missed, cell).r) == BACKGROUND_BITS;
    if (filled && has_depth(floatBitsToUint(z))) {
        float tolerance = push.relative == 1u ? push.tolerance * z : push.tolerance;
        float weights = OWN_WEIGHT;
        float sum = OWN_WEIGHT * imageLoad(correction, cell).r;
        [[unroll]] for (int k = 0; k < 9; ++k) {
            if (k == 4) continue;
            ivec2 at = cell + ivec2(k % 3, k / 3) - 1;
            bool inside = all(greaterThanEqual(at, ivec2(0))) && all(lessThan(at, ivec2(push.size)));
            ivec2 clamped = clamp(at, ivec2(0), ivec2(push.size) - 1);
            float found = imageLoad(filled_depth, clamped).r;
            bool has = inside && has_depth(floatBitsToUint(found));
            float difference = has ? found - z : 0.0;
            float weight = has ? anisotropic_weight(k, difference, tolerance) : 0.0;
            weights += weight;
            sum += weight * imageLoad(correction, clamped).r;
        }
        float mean = sum / weights;
        z = PERSPECTIVE ? z / (1.0 + mean) : z + mean;
    }
    imageStore(corrected_depth, cell, vec4(z));
}
