// The number of a pixel, or of a tile -> where it is, row by row. Declares no bindings.
#ifndef ROWS
#define ROWS

// CPUs divide whole numbers lane by lane. A quotient of floats is off by less than one row for pictures below 2^22 rows, and the remainder says which way.
ivec2 in_rows(uint number, uint width) {
    int wide = int(width);
    int y = int(float(int(number)) / float(wide));
    int x = int(number) - y * wide;
    int off = int(x >= wide) - int(x < 0);
    return ivec2(x - off * wide, y + off);
}

#endif
