// What a pixel's values mean. Declares no bindings.

const uint NO_POINT = 0xFFFFFFFFu;
// Depth of the background, and of a pixel whose surface is not known (yet): behind a hole, or in place of a hidden layer.
const uint BACKGROUND_BITS = 0x7F800000u;
const uint UNKNOWN_BITS = 0xFF800000u;

// While filling, a pixel is two words. The first: bits of its depth, with the sign set where the pixel is being filled. The second: its colour.
const uint FILLING = 0x80000000u;

// What lies outside of an image reads as 0 (robustImageAccess), and is no depth.
bool has_depth(uint bits) {
    return (bits & 0x7FFFFFFFu) - 1u < BACKGROUND_BITS - 1u;
}

// Linear colour as square roots, 11 + 11 + 10 bits: finer than sRGB's 8, and decoded by a multiplication. `light_of` is linear, in units of its own that save divisions.
const vec3 ROOTS = vec3(2047.0, 2047.0, 1023.0);

uint pack_light(vec3 light) {
    uvec3 q = uvec3(min(sqrt(light), ROOTS) + 0.5);
    return q.r | (q.g << 11) | (q.b << 22);
}

vec3 light_of(uint word) {
    vec3 root = vec3(word & 2047u, (word >> 11) & 2047u, word >> 22);
    return root * root;
}

uint pack_color(vec3 linear) {
    return pack_light(max(linear, 0.0) * (ROOTS * ROOTS));
}

vec3 unpack_color(uint word) {
    return light_of(word) / (ROOTS * ROOTS);
}
