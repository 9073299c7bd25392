// Where a pixel that filling by masks gave its values has them from, and how much farther they may go: one float, a whole number. Declares no bindings.
//
//   steps left * 2^16 + rows down * 2^8 + columns right, as seen from the pixel        steps 0 to 127, rows and columns -127 to 127
// Floats, because lavapipe loads images of integers several times slower.
const float STEP_LEFT = 65536.0;
const int ROW = 256;

// Of a pixel that has no values, and is to get some from neighbours that have: less than any source.
const float TO_BE_FILLED = -STEP_LEFT;

// Whether values may go another step.
bool goes_on(float source) {
    return source > 0.5 * STEP_LEFT;
}

// As a neighbour has it that lies so far aside -> as the pixel has it.
float taken_from(float source, ivec2 aside) {
    return source - mix(0.0, STEP_LEFT, goes_on(source)) + float(aside.y * ROW + aside.x);
}

// From a pixel to its source.
ivec2 way_to(float source) {
    int aside = ((int(source) + 0x8000) & 0xFFFF) - 0x8000;
    // Shifted, not divided: rows above are negative.
    int row = (aside + ROW / 2) >> 8;
    return ivec2(aside - row * ROW, row);
}
