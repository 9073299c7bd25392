// Sums of a pixel's points: for every channel two words that form one number of 64 bits. The
// includer has `levels`: the 256 values of every station at one exposure.
//
//   count * 2^36 + sum      of values 0 to 255, so that both hold 268,435,455 points (guide:
//                           numerics, case 23)
// Integers, so the order of additions is irrelevant. The channel is the largest of red, green and
// blue, V of HSV; or there are three, red, green and blue.

// Follows resolve.comp: words of points are bytes of colour, or lie on a ramp of 256 greys.
uvec3 shown_bytes(uint word, bool ramp, float lo, float scale) {
    uint grey = uint(clamp((float(word & 0xFFFFFFu) - lo) * scale, 0.0, 255.0));
    return ramp ? uvec3(grey) : uvec3(word & 255u, (word >> 8) & 255u, (word >> 16) & 255u);
}

// Returns the value of a point with this word.
uint level_of(uint value, uint word) {
    return imageLoad(levels, int((word >> 24) << 8 | value)).r;
}

uvec3 levels_of(uint word, bool ramp, float lo, float scale) {
    uvec3 bytes = shown_bytes(word, ramp, lo, scale);
    return uvec3(level_of(bytes.r, word), level_of(bytes.g, word), level_of(bytes.b, word));
}

uint value_of(uvec3 bytes) {
    return max(max(bytes.r, bytes.g), bytes.b);
}
