// Normal of a point (src/cloud/octahedral.rs): 24 bits of a word. Declares no bindings.

#ifndef OCTAHEDRAL
#define OCTAHEDRAL

#include "exact_dot.glsl"

const uint UNKNOWN_NORMAL = 0xFFFFFFu;

// Returns a unit vector.
vec3 normal_of(uint facing) {
    vec2 e = vec2(facing & 0xFFFu, (facing >> 12) & 0xFFFu) / vec2(2047.0) - vec2(1.0);
    float z = 1.0 - abs(e.x) - abs(e.y);
    vec2 folded = vec2((1.0 - abs(e.y)) * (e.x >= 0.0 ? 1.0 : -1.0), (1.0 - abs(e.x)) * (e.y >= 0.0 ? 1.0 : -1.0));
    vec3 n = z >= 0.0 ? vec3(e, z) : vec3(folded, z);
    return n / vec3(sqrt(dot_of(n, n)));
}

#endif
