// A pyramid of nearest points. Level 0 is the picture; a cell of level k covers 2^k x 2^k pixels
// and holds the depth of its nearest point, 0 or background without one; the point's place; the
// number of pixels with a point of the nearest surface; and that of pixels with any. Declares no
// bindings.
//
// Levels from 1 on lie in one image: level 1 at its corner, the others to the right of it, one
// below the other.

// A place is counted in pixels from the cell's corner, across and down, of less than 2^10 each.
float pack_place(vec2 place) {
    return place.x + 1024.0 * place.y;
}

vec2 unpack_place(float packed) {
    float down = floor(packed / 1024.0);
    return vec2(packed - 1024.0 * down, down);
}

// Returns the centre of the pixel of a cell's nearest point.
vec2 place_in(ivec2 cell, int level, vec4 texel) {
    return vec2(cell << level) + unpack_place(texel.g) + 0.5;
}

ivec2 level_size(ivec2 size, int level) {
    return (size + (1 << level) - 1) >> level;
}

ivec2 level_corner(ivec2 size, int level) {
    ivec2 corner = ivec2(level > 1 ? level_size(size, 1).x : 0, 0);
    [[dont_unroll]] for (int above = 2; above < level; ++above) corner.y += level_size(size, above).y;
    return corner;
}

// Points beyond the picture's edge are unknown. Edge cells are repeated there, moved outwards, so
// that surfaces and background continue.
int at_edge(int at, int side) {
    return clamp(at, 0, side - 1);
}

// Returns whether a cell may hold points: it lies inside, or beyond an edge that the cloud crosses,
// with bits for the first and the last edge.
bool may_hold(int at, int side, uint crossed) {
    return at < 0 ? (crossed & 1u) == 1u : at < side || (crossed & 2u) == 2u;
}

// Verdicts of a level on a pixel.
const uint TOO_FEW = 0u;
const uint UNDECIDED = 1u;
const uint OPEN = 2u;
const uint CLOSED = 3u;

// t |t| without a point: less than any other.
const float NOTHING = -1e37;

// Returns the solid angle of a sector as a share of its hemisphere, from its largest t |t|: up to 2
// where all points lie beyond the plane across the ray.
float cone(float lean) {
    float square = min(abs(lean), 1e18);
    float hypotenuse = 1.0 + square;
    float closed = 1.0 / (hypotenuse + sqrt(hypotenuse * square));
    return lean <= NOTHING ? 1.0 : lean > 0.0 ? closed : 2.0 - closed;
}

const float EIGHTH_OF_DISC = 0.39269908;
// If every neighbour leads, the density is unknown, but not infinite.
const float MOST_SHARE = 0.93;

// Judges a pixel by the leading points in a kernel (rule: visibility_levels.comp): their number,
// the area of each [cells], the number of their neighbours and of leading pairs, squared distances
// to the nearest in each sector [cells], and the remaining solid angle in sectors' hemispheres.
uint verdict(int leaders, float area, int fewest, int pairs, int neighbours, float squares, float cones, float closed, float expected) {
    float share = min(2.0 * float(pairs) / float(max(neighbours, 1)), MOST_SHARE);
    float root = sqrt(1.0 - share);
    bool is_open = share * squares * EIGHTH_OF_DISC * max(root / area, 1.0) >= expected * root;
    return leaders < fewest ? TOO_FEW : is_open ? OPEN : cones < closed ? CLOSED : UNDECIDED;
}

// Leaves points to the next level, whose words in `counts` are an indirect dispatch and their
// number; `place` is that of the first.
#define LEAVE(counts, next, many, place) { \
    uint words = 4u * uint(next); \
    place = atomicAdd(counts.word[words + 3u], many); \
    if (place / 64u != (place + many) / 64u || place % 64u == 0u) { \
        atomicMax(counts.word[words], min((place + many) / 64u + 1u, MOST_GROUPS)); \
        counts.word[words + 1u] = 1u; \
        counts.word[words + 2u] = 1u; \
    } \
}
