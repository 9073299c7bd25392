// The light's depths -> the same with gaps closed through which the light would fall: occluded and background fill (Dobrev et al. 2010, sec. 3.2 and 3.3).
//
//   in front: those of the eight neighbours that are nearer by more than the layer of the steepest surface
//   five consecutive ones that are not (half of the ring: a straight or diagonal silhouette): the texel stays; else it takes the nearest
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "pixel.glsl"
#include "light.glsl"
#include "masks.glsl"

layout(local_size_x = 64) in;

layout(r32f) readonly uniform image2D depth;
layout(r32f) writeonly uniform image2D filled;

void main() {
    ivec2 texel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(texel, ivec2(push.size)))) return;
    float z = imageLoad(depth, texel).r;
    bool has = has_depth(floatBitsToUint(z));
    float own = has ? z : 1.0;
    float front = own - along_light(layer_at(own), push.steepest);
    float nearest = uintBitsToFloat(BACKGROUND_BITS);
    uint open = 0u;
    [[unroll]] for (int k = 0; k < 8; ++k) {
        float other = imageLoad(depth, texel + RING[k]).r;
        bool before = has_depth(floatBitsToUint(other)) && (!has || other < front);
        nearest = before ? min(nearest, other) : nearest;
        open |= uint(!before) << k;
    }
    bool stays = any_mask(open);
    imageStore(filled, texel, vec4(stays ? z : nearest));
}
