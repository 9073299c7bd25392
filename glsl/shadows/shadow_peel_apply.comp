// Keys of a peel -> visibility: every texel's next point is lit by this sample of the light (Dobrev
// et al. 2010, sec. 6). Keys become those of the last peel and are free for the next.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require

#include "pixel.glsl"

layout(local_size_x = 64) in;

// Number of points that some peels have reached.
layout(scalar) buffer Peeled { uint count[]; } peeled;
layout(scalar) buffer Keys { uvec2 key[]; } keys;
layout(scalar) buffer Last { uvec2 key[]; } last;
// One byte per point.
layout(scalar) buffer LightVisibility { uint word[]; } light_visibility;

layout(push_constant, scalar) uniform Push {
    uvec2 size; // texels
} push;

void main() {
    uvec2 at = gl_GlobalInvocationID.xy;
    if (at.x >= push.size.x || at.y >= push.size.y) return;
    uint texel = at.y * push.size.x + at.x;
    uvec2 key = keys.key[texel];
    if (key.x == NO_POINT) return;
    atomicAdd(light_visibility.word[key.x / 4u], 1u << (8u * (key.x & 3u)));
    last.key[texel] = key;
    keys.key[texel] = uvec2(NO_POINT);
    atomicAdd(peeled.count[0], 1u);
}
