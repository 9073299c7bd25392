// Values of pixels. Declares no bindings.

const uint NO_POINT = 0xFFFFFFFFu;
// Depth of the background, and of a pixel whose surface is unknown: behind a hole, or in place of a
// hidden layer.
const uint BACKGROUND_BITS = 0x7F800000u;
const uint UNKNOWN_BITS = 0xFF800000u;

// While filling, a pixel is two floats: its depth, negative if the pixel is being filled, and its
// colour. Floats, because lavapipe loads integer images several times slower.
const uint FILLING = 0x80000000u;

// Pixels outside of an image read 0 (robustImageAccess), which is no depth.
bool has_depth(uint bits) {
    return (bits & 0x7FFFFFFFu) - 1u < BACKGROUND_BITS - 1u;
}

// Returns the weight of a neighbour, number k of 3 x 3: (1 - r / 2) (1 - min(1, |difference| /
// tolerance)) as in anisotropic filling (Pintus et al. 2011, sec. 5). Without a tolerance, only
// equal depths are of one surface.
float anisotropic_weight(int k, float difference, float tolerance) {
    float strictness = tolerance > 0.0 ? min(1.0 / tolerance, 3.402823466e38) : 3.402823466e38;
    return (k % 2 == 0 ? 0.292893219 : 0.5) * (1.0 - min(1.0, abs(difference) * strictness));
}

// Linear colour as square roots of 8 bits each, which is near sRGB and decoded by a multiplication:
// the 23 mantissa bits of a float and its sign. The float's exponent, from 1 to 254, is the
// opacity, so that it is always a normal number. `light_of` is linear, in units of its own that
// save divisions.
const float ROOTS = 255.0;
const uint OPACITY_BITS = 0x7F800000u;
const float OPACITIES = 253.0;

float pack_light(vec3 light, uint opacity_bits) {
    // By way of signed integers, which CPUs convert in one instruction.
    ivec3 q = ivec3(min(sqrt(light), ROOTS) + 0.5);
    return uintBitsToFloat(uint(q.r | (q.g << 8) | ((q.b & 127) << 16) | ((q.b & 128) << 24)) | opacity_bits);
}

vec3 light_of(float packed_light) {
    int word = floatBitsToInt(packed_light);
    vec3 root = vec3(ivec3(word & 255, (word >> 8) & 255, ((word >> 16) & 127) | ((word >> 24) & 128)));
    return root * root;
}

uint opacity_bits(float packed_light) {
    return floatBitsToUint(packed_light) & OPACITY_BITS;
}

float pack_color(vec4 linear) {
    return pack_light(max(linear.rgb, 0.0) * (ROOTS * ROOTS), uint(clamp(linear.a, 0.0, 1.0) * OPACITIES + 1.5) << 23);
}

vec4 unpack_color(float packed_light) {
    // Mesa rearranges a vector times a scalar in spite of NoContraction, but not a vector times a
    // vector.
    vec3 linear = light_of(packed_light) * vec3(1.0 / (ROOTS * ROOTS));
    return vec4(linear, (float(opacity_bits(packed_light) >> 23) - 1.0) / OPACITIES);
}
