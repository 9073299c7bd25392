// What a pixel's points add up to: of every channel two words, which together are one number of 64 bits. The includer has `levels`: of every station, what its 256 values are with one exposure for all.
//
//   count * 2^36 + sum      of values 0 to 255, so that both hold 268,435,455 points (HARD_CASES 23)
// Whole numbers, so that no order of adding shows. The channel is the largest of red, green and blue, V of HSV, as the points have it; or there are three, red, green and blue.

// As in resolve.comp: the points' words are bytes of colour, or lie on a ramp of 256 grey ones.
uvec3 shown_bytes(uint word, bool ramp, float lo, float scale) {
    uint grey = uint(clamp((float(word) - lo) * scale, 0.0, 255.0));
    return ramp ? uvec3(grey) : uvec3(word & 255u, (word >> 8) & 255u, (word >> 16) & 255u);
}

// A value of a point with this word.
uint level_of(uint value, uint word, bool ramp) {
    return imageLoad(levels, int((ramp ? 0u : word >> 24) << 8 | value)).r;
}

uvec3 levels_of(uint word, bool ramp, float lo, float scale) {
    uvec3 bytes = shown_bytes(word, ramp, lo, scale);
    return uvec3(level_of(bytes.r, word, ramp), level_of(bytes.g, word, ramp), level_of(bytes.b, word, ramp));
}

uint value_of(uvec3 bytes) {
    return max(max(bytes.r, bytes.g), bytes.b);
}
