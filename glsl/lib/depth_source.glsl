// Source of the values of a pixel filled by masks, and the steps that they may still go: a whole
// number in a float. Declares no bindings.
//
//   steps left * 2^16 + rows down * 2^8 + columns right, relative to the pixel
//   steps 0 to 127, rows and columns -127 to 127
// Floats, because lavapipe loads integer images several times slower.
const float STEP_LEFT = 65536.0;
const int ROW = 256;

// For a pixel without values that is to be filled: less than any source.
const float TO_BE_FILLED = -STEP_LEFT;

// Returns whether values may go another step.
bool goes_on(float source) {
    return source > 0.5 * STEP_LEFT;
}

// Converts the source of a neighbour at `aside` to one relative to the pixel.
float taken_from(float source, ivec2 aside) {
    return source - mix(0.0, STEP_LEFT, goes_on(source)) + float(aside.y * ROW + aside.x);
}

// Returns the offset from a pixel to its source.
ivec2 way_to(float source) {
    int aside = ((int(source) + 0x8000) & 0xFFFF) - 0x8000;
    // Shifted, not divided: rows above are negative.
    int row = (aside + ROW / 2) >> 8;
    return ivec2(aside - row * ROW, row);
}
