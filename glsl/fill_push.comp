// A level of a pyramid and the next coarser one in; pixels of the finer that are to be filled take the mean of the four coarse pixels around them, weighted bilinearly, out in place
// (Grossman and Dally 1998, sec. 7; Marroquim, Kraus and Cavalcanti 2008, sec. 4).
//
// Only those of the four count that have a value and are of one surface with the coarse pixel that this one lies in; where that has none, with the nearest of them.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "pixel.glsl"

layout(local_size_x = 64) in;

layout(r32f) readonly uniform image2D coarse_depth;
layout(rgba32f) readonly uniform image2D coarse_color;
layout(r32f) uniform image2D depth;
layout(rgba32f) uniform image2D color;

layout(push_constant, scalar) uniform Push {
    uvec2 coarse_size;
    uvec2 size;
    float tolerance; // of depth: metres, or, where it is relative, parts of the depth
    uint relative;
    uint flood; // 1: background is to be filled, too
} push;

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, ivec2(push.size)))) return;
    uint own = floatBitsToUint(imageLoad(depth, pixel).r);
    // A loop for a condition: lavapipe leaves a loop that no lane runs, and walks through a branch that none takes.
    for (bool filling = own == UNKNOWN_BITS || (push.flood == 1u && own == BACKGROUND_BITS); filling; filling = false) {
        ivec2 parent = pixel / 2;
        ivec2 toward = 2 * (pixel % 2) - 1;
        float z[4];
        vec4 c[4];
        float nearest = uintBitsToFloat(BACKGROUND_BITS);
        [[unroll]] for (int k = 0; k < 4; ++k) {
            ivec2 at = parent + toward * ivec2(k % 2, k / 2);
            bool inside = all(greaterThanEqual(at, ivec2(0))) && all(lessThan(at, ivec2(push.coarse_size)));
            at = clamp(at, ivec2(0), ivec2(push.coarse_size) - 1);
            float found = imageLoad(coarse_depth, at).r;
            z[k] = inside && found >= 0.0 ? found : uintBitsToFloat(BACKGROUND_BITS);
            c[k] = imageLoad(coarse_color, at);
            nearest = min(nearest, z[k]);
        }
        bool reached = has_depth(floatBitsToUint(nearest));
        float like = has_depth(floatBitsToUint(z[0])) ? z[0] : nearest;
        float tolerance = push.relative == 1u ? push.tolerance * like : push.tolerance;
        float weights = 0.0;
        float rise = 0.0;
        vec4 sum = vec4(0.0);
        [[unroll]] for (int k = 0; k < 4; ++k) {
            bool has = has_depth(floatBitsToUint(z[k]));
            float difference = has ? z[k] - like : 0.0;
            float weight = has && abs(difference) <= tolerance ? (k == 0 ? 9.0 : k == 3 ? 1.0 : 3.0) : 0.0;
            weights += weight;
            rise += weight * difference;
            sum += weight * c[k];
        }
        float mean = like + rise / max(weights, 1.0);
        imageStore(depth, pixel, vec4(reached ? mean : uintBitsToFloat(BACKGROUND_BITS)));
        imageStore(color, pixel, reached ? sum / max(weights, 1.0) : vec4(0.0));
    }
}
