// A level of a pyramid in, the next coarser one out: each pixel the mean of those of its 2 x 2 that have a value and belong to the nearest surface among them
// (Grossman and Dally 1998, sec. 7; Marroquim, Kraus and Cavalcanti 2008, sec. 4).
//
// A pixel without a value is not known where one of its four is not, else background.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "pixel.glsl"

layout(local_size_x = 64) in;

layout(r32f) readonly uniform image2D fine_depth;
layout(rgba32f) readonly uniform image2D fine_color;
layout(r32f) writeonly uniform image2D depth;
layout(rgba32f) writeonly uniform image2D color;

layout(push_constant, scalar) uniform Push {
    uvec2 fine_size;
    uvec2 size;
    float tolerance; // of depth: metres, or, where it is relative, parts of the depth
    uint relative;
} push;

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, ivec2(push.size)))) return;
    ivec2 last = ivec2(push.fine_size) - 1;
    float z[4];
    float nearest = uintBitsToFloat(BACKGROUND_BITS);
    bool unknown = false;
    [[unroll]] for (int k = 0; k < 4; ++k) {
        ivec2 at = 2 * pixel + ivec2(k % 2, k / 2);
        float found = imageLoad(fine_depth, min(at, last)).r;
        z[k] = all(lessThanEqual(at, last)) ? found : uintBitsToFloat(BACKGROUND_BITS);
        unknown = unknown || z[k] < 0.0;
        nearest = z[k] >= 0.0 ? min(nearest, z[k]) : nearest;
    }
    float tolerance = push.relative == 1u ? push.tolerance * nearest : push.tolerance;
    float count = 0.0;
    float rise = 0.0;
    vec4 sum = vec4(0.0);
    [[unroll]] for (int k = 0; k < 4; ++k) {
        bool has = has_depth(floatBitsToUint(z[k])) && z[k] >= 0.0;
        float difference = has ? z[k] - nearest : 0.0;
        has = has && difference <= tolerance;
        vec4 c = imageLoad(fine_color, min(2 * pixel + ivec2(k % 2, k / 2), last));
        count += has ? 1.0 : 0.0;
        rise += has ? difference : 0.0;
        sum += has ? c : vec4(0.0);
    }
    float mean = nearest + rise / max(count, 1.0);
    bool valued = count > 0.0;
    imageStore(depth, pixel, vec4(valued ? mean : uintBitsToFloat(unknown ? UNKNOWN_BITS : BACKGROUND_BITS)));
    imageStore(color, pixel, valued ? sum / count : vec4(0.0));
}
