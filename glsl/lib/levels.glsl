// A pyramid of nearest points. Level 0 is the picture; a cell of level k covers 2^k x 2^k pixels and holds its nearest point: its depth in one image, and where it lies in another. Declares no bindings.
//
// Levels from 1 on lie in one image: level 1 at its corner, the others to the right of it, one below the other.

// Of a place in a cell: pixels from its corner, across and down, in one number.
const float ROW_OF_PLACES = 256.0;
const float NO_PLACE = -1.0;

// The middle of a pixel of a cell.
vec2 place_in(ivec2 cell, int level, float code) {
    float down = floor(code * (1.0 / ROW_OF_PLACES));
    return vec2(cell << level) + vec2(code - ROW_OF_PLACES * down, down) + 0.5;
}

ivec2 level_size(ivec2 size, int level) {
    return (size + (1 << level) - 1) >> level;
}

ivec2 level_corner(ivec2 size, int level) {
    ivec2 corner = ivec2(level > 1 ? level_size(size, 1).x : 0, 0);
    [[dont_unroll]] for (int above = 2; above < level; ++above) corner.y += level_size(size, above).y;
    return corner;
}

// Points beyond the picture's edge are not known: the cells at the edge stand for them, moved outwards, so that a surface goes on there, and so does the background.
int at_edge(int at, int side) {
    return clamp(at, 0, side - 1);
}
