// Number of a pixel or tile -> its column and row. Declares no bindings.
#ifndef ROWS
#define ROWS

// CPUs divide integers lane by lane. A quotient of floats is off by less than one row for pictures
// below 2^22 rows, and the remainder gives the correction.
ivec2 in_rows(uint number, uint width) {
    int wide = int(width);
    int y = int(float(int(number)) / float(wide));
    int x = int(number) - y * wide;
    int off = int(x >= wide) - int(x < 0);
    return ivec2(x - off * wide, y + off);
}

#endif
