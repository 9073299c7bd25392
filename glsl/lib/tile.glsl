// Tiles of 8 x 8 pixels: what is known of one, and lists of those that a pass is to work on. Declares no bindings.
//
// A list is words in a buffer, from a place `at` on: three words of an indirect dispatch, the number of tiles, then the tiles: their numbers, or in an area (lib/area.glsl, which goes row by
// row) how far across and down they are. It starts as zeros. A workgroup of 64 takes eight tiles at a time, a lane a column of eight pixels, from top to bottom: what a column's pixels share is found once, and eight lanes side by side load side by side. Workgroups go on until the list ends, so that it may be
// longer than the 65,535 workgroups that every device dispatches allow.

#include "rows.glsl"
#include "word.glsl"

const int TILE_PX = 8;
// Of packed depth, on every side: as far as the widest kernel looks.
const int MARGIN_PX = 16;
const uint LIST_HEADER = 4u;
const uint MOST_GROUPS = 65535u;
const uint TILES_PER_GROUP = 8u;

struct Tile {
    uint points;     // pixels that hold one
    uint front;      // of those, that are of the surface that is nearest in it: of each of its quarters a byte, 0 where the picture ends in one
    uint pairs;      // of two of them, side by side or one above the other
    uint continuous; // 1: every pixel holds a point, and neighbours differ by less than a hidden layer would
    float nearest;   // depth, where it holds points
    float spacing;   // of its node's points where it is nearest, pixels; 0 where no point is
};

// Whether a depth is of the same surface as the nearest one: no more than `front_px` pixels' width behind it.
bool in_front(float depth, float nearest, float front_px, float px_per_unit, bool perspective) {
    return (depth - nearest) * px_per_unit <= front_px * (perspective ? nearest : 1.0);
}

// Pixels of the nearest surface, of all quarters.
uint in_quarters(uint front) {
    return (front & 255u) + (front >> 8 & 255u) + (front >> 16 & 255u) + (front >> 24);
}

// Of points strewn over pixels a share of which hold one: from point to point, pixels. A share p of them holds some where -ln(1 - p) fall into one, which p / sqrt(1 - p) is near enough, and infinite where
// all do: dense surfaces are not sparser than their nodes.
float apart(float share) {
    return sqrt(sqrt(max(1.0 - share, 0.0)) / share);
}

// The includer has a buffer `lists` of words.
#define APPEND(at, tile) { \
    uint place = atomicAdd(lists.word[(at) + 3u], 1u); \
    lists.word[(at) + LIST_HEADER + place] = (tile); \
    lists.word[(at) + 1u] = 1u; \
    lists.word[(at) + 2u] = 1u; \
    atomicMax(lists.word[at], min(place / TILES_PER_GROUP + 1u, MOST_GROUPS)); \
}

// Runs `work` for every tile of a list, by its place in it; local_size_x = 64.
//
// Loops are tested at their ends, here and wherever time matters: through the body of one that is tested at its beginning lavapipe walks once more, with all lanes off. It walks through branches that no
// lane takes, too.
#define FIRST_PLACE (gl_WorkGroupID.x * TILES_PER_GROUP + gl_LocalInvocationID.x / 8u)
#define TO_NEXT_PLACE (gl_NumWorkGroups.x * TILES_PER_GROUP)
#define EACH_OF(count, work) { \
    uint end = (count); \
    uint n = FIRST_PLACE; \
    if (n < end) for (;;) { \
        work(n); \
        n += TO_NEXT_PLACE; \
        if (n >= end) break; \
    } \
}

// Runs `work` for pixels of listed tiles, or for texels of `rows` rows of pixels each, also for some beyond the picture's edges: `tile_at` says of a place in the list how far across and down its tile is. A workgroup takes
// eight tiles at a time, eight lanes a row of each, one tile after the other: lanes side by side, and a row of what is most often a row of tiles, so that memory is read in the order in which a pass over
// the whole picture reads it. Column by column, tile by tile, costs a software device a quarter more.
#define EACH_TEXEL_OF(count, tile_at, rows, work) { \
    const uint DOWN = uint(TILE_PX / (rows)); \
    uint lanes = gl_LocalInvocationID.x / 8u; \
    ivec2 own = ivec2(gl_LocalInvocationID.x % 8u, lanes * DOWN / TILES_PER_GROUP); \
    uint end = (count); \
    uint n = gl_WorkGroupID.x * TILES_PER_GROUP + lanes * DOWN % TILES_PER_GROUP; \
    uint to_go = DOWN; \
    if (n < end) for (;;) { \
        work(tile_at(n) * ivec2(TILE_PX, DOWN) + own); \
        to_go -= 1u; \
        n += to_go > 0u ? 1u : TO_NEXT_PLACE - DOWN + 1u; \
        to_go = to_go > 0u ? to_go : DOWN; \
        if (n >= end) break; \
    } \
}

ivec2 tile_corner(uint tile, uint tiles_across) {
    return in_rows(tile, tiles_across) * TILE_PX;
}

// The top pixel of this lane's column.
ivec2 column_of(uint tile, uint tiles_across) {
    return tile_corner(tile, tiles_across) + ivec2(gl_LocalInvocationID.x % 8u, 0);
}
