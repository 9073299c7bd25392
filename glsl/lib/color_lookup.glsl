// A point's word -> its colour. The includer has `table`, and the constant MODE.

const uint RGB = 0u;
const uint RAMP = 1u;
const uint PALETTE = 2u;
const uint NORMAL = 3u;
const uint CONSTANT = 4u;

vec4 color_of(uint entry) {
    return uintBitsToFloat(imageLoad(table, int(entry)));
}

// Returns a linear colour. Words at the ends of the ramp are `lo` and `lo + 255 / scale`.
vec4 painted(uint word, float lo, float scale) {
    vec4 c = vec4(0.0);
    // Every station has a row of the table.
    uint row = (word >> 24) << 8;
    if (MODE == RGB) c = vec4(color_of(row | (word & 255u)).r, color_of(row | ((word >> 8) & 255u)).g, color_of(row | ((word >> 16) & 255u)).b, 1.0);
    if (MODE == RAMP) c = color_of(row | uint(clamp((float(word & 0xFFFFFFu) - lo) * scale, 0.0, 255.0)));
    if (MODE == PALETTE) c = color_of(word & 255u);
    if (MODE == NORMAL) c = vec4(vec3(word & 255u, (word >> 8) & 255u, (word >> 16) & 255u) / 254.0, 1.0);
    if (MODE == CONSTANT) c = color_of(0u);
    return c;
}
