// The light's depths -> the same with gaps closed through which the light would fall: occluded and background fill (Dobrev et al. 2010, sec. 3.2 and 3.3).
//
//   in front: those of the eight neighbours that are nearer by more than the layer
//   slope:    the steepest among those in front, from one to the next around the texel, and from the texel to those that are not
//             where three or more are empty, as at a rim, nobody knows: the steepest there is
//   in front: those that are nearer by more than the layer of a surface with that slope
//   five consecutive ones that are not (half of the ring: a straight or diagonal silhouette): the texel stays; else it takes the nearest
//
// With one fixed layer, that of the steepest surface, gaps in what lies less than five times as far in front of something else as its own layer stayed open. On a plane the neighbours down its slope are
// not in front, and the slope is known from both sides of the texel, so that it stays as it is. What an earlier step has filled may be a layer too near, so each step asks for one layer more, up to that of
// the steepest surface.
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
    float run = texel_at(own);
    float layer = layer_at(own);
    float most = along_light(layer, push.steepest);
    layer *= push.filled + 1.0;

    float other[8];
    bool known[8];
    bool before[8];
    float front = own - min(layer, most);
    [[unroll]] for (int k = 0; k < 8; ++k) {
        other[k] = imageLoad(depth, texel + RING[k]).r;
        known[k] = has_depth(floatBitsToUint(other[k]));
        before[k] = known[k] && other[k] < front;
    }
    int empty = 0;
    [[unroll]] for (int k = 0; k < 8; ++k) empty += known[k] ? 0 : 1;
    float tangent = empty < 3 ? 0.0 : push.steepest;
    [[unroll]] for (int k = 0; k < 8; ++k) {
        int next = (k + 1) % 8;
        float among = before[k] && before[next] ? tangent_of(other[next] - other[k], run) : 0.0;
        float aside = known[k] && !before[k] ? tangent_of(other[k] - own, run_to(k, run)) : 0.0;
        tangent = max(tangent, max(among, aside));
    }
    front = own - min(along_light(layer, min(tangent, push.steepest)), most);
    float nearest = uintBitsToFloat(BACKGROUND_BITS);
    uint open = 0u;
    [[unroll]] for (int k = 0; k < 8; ++k) {
        bool closes = known[k] && (!has || other[k] < front);
        nearest = closes ? min(nearest, other[k]) : nearest;
        open |= uint(!closes) << k;
    }
    imageStore(filled, texel, vec4(any_mask(open) ? z : nearest));
}
