// The light's depths -> how deep in each texel the light reaches: depth + layer / <v, n> (Dobrev et al. 2010, sec. 6).
//
// Points have no normals; the slope is the steepest one to the eight neighbours of the same surface. Within a texel a plane falls away by no more than from its depth here to that of the neighbour
// across the lower corner, which is sqrt(2) texels away: with a layer of sqrt(2) texels' sides no plane shades itself (HARD_CASES 13).
// The flatter side of each axis would not do: where both of two neighbours' depths are by chance the same, steep planes shade themselves. So at an edge the drop to what lies behind it counts as slope, and
// the texel's own part of the shadow begins as far back as behind the steepest surface.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "pixel.glsl"
#include "light.glsl"

layout(local_size_x = 64) in;

layout(r32f) readonly uniform image2D depth;
layout(r32f) writeonly uniform image2D limit;

void main() {
    ivec2 texel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(texel, ivec2(push.size)))) return;
    float z = imageLoad(depth, texel).r;
    bool has = has_depth(floatBitsToUint(z));
    float own = has ? z : 1.0;
    float run = texel_at(own);
    float tangent = 0.0;
    [[unroll]] for (int k = 0; k < 8; ++k) {
        float other = imageLoad(depth, texel + RING[k]).r;
        float rise = (has_depth(floatBitsToUint(other)) ? other : own) - own;
        tangent = max(tangent, tangent_of(rise, run_to(k, run)));
    }
    float reach = own + along_light(layer_at(own), min(tangent, push.steepest));
    // A layer that is lost beside the depth still holds the depth itself (HARD_CASES 15).
    float beyond = max(reach, uintBitsToFloat(floatBitsToUint(own) + 1u));
    imageStore(limit, texel, vec4(has ? beyond : z));
}
