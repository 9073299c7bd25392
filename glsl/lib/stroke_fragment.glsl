// A fragment of a stroke: square roots of linear colour, which are near sRGB, and the light that it
// leaves, 8 bits each; depth bits. Declares no bindings.

// Returns whether a is nearer, or as near and before b in an order that depends only on the two:
// for the same brush, the one that leaves less comes first, the stroke whose middle is nearer to
// the pixel.
bool before(uvec2 a, uvec2 b) {
    return a.y < b.y || a.y == b.y && a.x < b.x;
}

uint pack_roots(vec3 roots) {
    uvec3 q = uvec3(min(roots, vec3(1.0)) * vec3(255.0) + vec3(0.5));
    return q.r | q.g << 8 | q.b << 16;
}

vec3 roots_of(uint word) {
    return vec3(word & 255u, word >> 8 & 255u, word >> 16 & 255u) / vec3(255.0);
}

float coverage_of(uint word) {
    return float(255u - (word >> 24)) / 255.0;
}

// Share of 1 below which points behind change no 8-bit colour.
const float LEAST = 0.001953125;

bool shows(vec4 sum) {
    return 1.0 - sum.a >= LEAST;
}

// Composites colour times coverage, and coverage, over a fragment: linear (guide: numerics, case
// 17).
vec4 over(vec4 sum, uint fragment) {
    float light = (1.0 - sum.a) * coverage_of(fragment);
    vec3 roots = roots_of(fragment);
    return vec4(sum.rgb + roots * roots * vec3(light), sum.a + light);
}
