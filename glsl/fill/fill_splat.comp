// Fixed-size splats: depth, index and colour of points -> those of the nearest point within a disc
// of `radius` pixels around each pixel.
//
// This is what drawing every point as a disc of that size leaves in a depth buffer. Pixels that no
// disc covers are background. Among equal depths the upper left one is taken, so the picture does
// not depend on the order of execution.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require

#include "pixel.glsl"

layout(local_size_x = 64) in;

layout(r32f) readonly uniform image2D depth;
layout(r32ui) readonly uniform uimage2D index;
layout(rgba32f) readonly uniform image2D color;
layout(r32f) writeonly uniform image2D splat_depth;
layout(r32ui) writeonly uniform uimage2D splat_index;
layout(rgba32f) writeonly uniform image2D splat_color;

layout(push_constant, scalar) uniform Push {
    uvec2 size;   // pixels
    float radius; // pixels
} push;

void main() {
    ivec2 size = ivec2(push.size);
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, size))) return;
    int reach = int(push.radius);
    float square = push.radius * push.radius;
    float nearest = uintBitsToFloat(BACKGROUND_BITS);
    ivec2 nearest_at = ivec2(-1);
    for (int dy = -reach; dy <= reach; ++dy) {
        for (int dx = -reach; dx <= reach; ++dx) {
            ivec2 at = pixel + ivec2(dx, dy);
            bool near = float(dx * dx + dy * dy) <= square && all(greaterThanEqual(at, ivec2(0))) && all(lessThan(at, size));
            float z = imageLoad(depth, clamp(at, ivec2(0), size - 1)).r;
            // Pixels that visibility removed are minus infinity.
            bool nearer = near && z >= 0.0 && z < nearest;
            nearest_at = nearer ? at : nearest_at;
            nearest = nearer ? z : nearest;
        }
    }
    bool covered = nearest_at.x >= 0;
    ivec2 from = max(nearest_at, ivec2(0));
    imageStore(splat_depth, pixel, vec4(nearest));
    imageStore(splat_index, pixel, uvec4(covered ? imageLoad(index, from).r : NO_POINT));
    imageStore(splat_color, pixel, covered ? imageLoad(color, from) : vec4(0.0));
}
