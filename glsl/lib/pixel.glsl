// What a pixel's values mean. Declares no bindings.

const uint NO_POINT = 0xFFFFFFFFu;
// Depth of the background, and of a pixel whose surface is not known (yet): behind a hole, or in place of a hidden layer.
const uint BACKGROUND_BITS = 0x7F800000u;
const uint UNKNOWN_BITS = 0xFF800000u;

// While filling, a pixel is two floats: its depth, negative where the pixel is being filled, and its colour. Floats, because lavapipe loads images of integers several times slower.
const uint FILLING = 0x80000000u;

// What lies outside of an image reads as 0 (robustImageAccess), and is no depth.
bool has_depth(uint bits) {
    return (bits & 0x7FFFFFFFu) - 1u < BACKGROUND_BITS - 1u;
}

// Linear colour as square roots of 8 bits each, which is near sRGB and decoded by a multiplication; together a whole number that a float holds exactly. `light_of` is linear, in units of its own that
// save divisions.
const float ROOTS = 255.0;

float pack_light(vec3 light) {
    // By way of signed integers, which CPUs convert in one instruction.
    ivec3 q = ivec3(min(sqrt(light), ROOTS) + 0.5);
    return float(q.r | (q.g << 8) | (q.b << 16));
}

vec3 light_of(float packed_light) {
    int word = int(packed_light);
    vec3 root = vec3(ivec3(word & 255, (word >> 8) & 255, word >> 16));
    return root * root;
}

float pack_color(vec3 linear) {
    return pack_light(max(linear, 0.0) * (ROOTS * ROOTS));
}

vec3 unpack_color(float packed_light) {
    // Mesa rearranges a vector times a scalar in spite of NoContraction, but not a vector times a vector.
    return light_of(packed_light) * vec3(1.0 / (ROOTS * ROOTS));
}
