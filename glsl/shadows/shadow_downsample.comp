// Depths of the light's picture -> those of its half-size picture: the nearest of 2 x 2 texels,
// infinite without points.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "pixel.glsl"
#include "tile.glsl"
#include "tile_mask.glsl"

layout(local_size_x = 64) in;

#include "light_depth.glsl"

layout(scalar) writeonly buffer Halved { float texel[]; } halved;

void main() {
    ivec2 size = ivec2(push.size);
    ivec2 across = (size + 1) / 2;
    ivec2 texel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(texel, across))) return;
    float nearest = uintBitsToFloat(BACKGROUND_BITS);
    [[unroll]] for (int k = 0; k < 4; ++k) {
        ivec2 at = 2 * texel + ivec2(k % 2, k / 2);
        float z = depth_of(at.y * size.x + at.x);
        bool inside = all(lessThan(at, size)) && is_depth(z);
        nearest = inside ? min(nearest, z) : nearest;
    }
    halved.texel[texel.y * across.x + texel.x] = nearest;
}
