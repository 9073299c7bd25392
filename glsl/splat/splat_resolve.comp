// Keys of discs, and a surface -> the nearer of both in a strip of the picture: depth of the disc,
// and id and colour of its point; or those of the surface.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require

#include "pixel.glsl"
#include "pixel_index.glsl"

layout(local_size_x = 64) in;

layout(scalar) readonly buffer Keys { uvec2 key[]; } keys;
layout(r32ui) readonly uniform uimage2D index;
layout(rgba32f) readonly uniform image2D color;
layout(r32f) readonly uniform image2D surface_depth;
layout(r32ui) readonly uniform uimage2D surface_index;
layout(rgba32f) readonly uniform image2D surface_color;
layout(r32f) writeonly uniform image2D splat_depth;
layout(r32ui) writeonly uniform uimage2D splat_index;
layout(rgba32f) writeonly uniform image2D splat_color;

// Variant that draws over a surface.
layout(constant_id = 0) const bool OVER = false;

layout(push_constant, scalar) uniform Push {
    uvec2 size; // pixels of the strip
    uint top;   // first row of the strip
} push;

void main() {
    ivec2 at = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(at, ivec2(push.size)))) return;
    uvec2 key = keys.key[uint(at.y) * push.size.x + uint(at.x)];
    ivec2 pixel = at + ivec2(0, int(push.top));
    bool covered = key.x != NO_POINT;
    float z = uintBitsToFloat(covered ? key.y : BACKGROUND_BITS);
    uint point = NO_POINT;
    vec4 shown = vec4(0.0);
    float behind = OVER ? imageLoad(surface_depth, pixel).r : z;
    // A pixel of unknown depth, of which no surface was filled, has less than all others.
    if (OVER && (!covered || (has_depth(floatBitsToUint(behind)) && behind < z))) {
        z = behind;
        point = imageLoad(surface_index, pixel).r;
        shown = imageLoad(surface_color, pixel);
    } else if (covered) {
        ivec2 from = in_rows(key.x, push.size.x);
        point = imageLoad(index, from).r;
        shown = imageLoad(color, from);
    }
    imageStore(splat_depth, pixel, vec4(z));
    imageStore(splat_index, pixel, uvec4(point));
    imageStore(splat_color, pixel, shown);
}
