// What a pixel's values mean. Declares no bindings.

const uint NO_POINT = 0xFFFFFFFFu;
// Depth of the background, and of a pixel whose surface is not known (yet): behind a hole, or in place of a hidden layer.
const uint BACKGROUND_BITS = 0x7F800000u;
const uint UNKNOWN_BITS = 0xFF800000u;

// While filling, a pixel is two words. The first: bits of its depth, with the sign set where the pixel is being filled. The second: its colour.
const uint FILLING = 0x80000000u;

bool has_depth(uint bits) {
    return (bits & 0x7FFFFFFFu) < BACKGROUND_BITS;
}

// Linear colour as square roots, 11 + 11 + 10 bits: finer than sRGB's 8, and decoded by a multiplication.
uint pack_color(vec3 linear) {
    uvec3 q = uvec3(sqrt(clamp(linear, 0.0, 1.0)) * vec3(2047.0, 2047.0, 1023.0) + 0.5);
    return q.r | (q.g << 11) | (q.b << 22);
}

vec3 unpack_color(uint word) {
    vec3 root = vec3(word & 2047u, (word >> 11) & 2047u, word >> 22) / vec3(2047.0, 2047.0, 1023.0);
    return root * root;
}
