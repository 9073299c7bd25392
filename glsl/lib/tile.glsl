// Tiles of 8 x 8 pixels, and lists of tiles. Declares no bindings.
//
// A list is words in a buffer from a place `at` on: three words of an indirect dispatch, the number
// of tiles, then the tiles: their numbers, or in a tile mask (lib/tile_mask.glsl, which goes row by
// row) column and row. It starts as zeros. A workgroup of 64 takes eight tiles at a time, a lane a
// column of eight pixels from top to bottom: what a column's pixels share is computed once, and
// eight adjacent lanes load adjacent pixels. Workgroups continue until the list ends, so it may be
// longer than the 65,535 workgroups that every device allows.

#include "pixel_index.glsl"
#include "buffer_word.glsl"

const int TILE_PX = 8;
// Margin of packed depth on every side: as far as the widest kernel looks, in whole texels.
const int MARGIN_PX = 8;
const uint LIST_HEADER = 4u;
const uint MOST_GROUPS = 65535u;
const uint TILES_PER_GROUP = 8u;

// Bits of a tile's pixels are two words: one byte per column of pixels, from the top.
struct Tile {
    uint points_left;  // pixels with a point
    uint points_right;
    uint empty_left;   // pixels without a point
    uint empty_right;
    uint continuous;   // 1: all pixels hold points without a gap for hidden layers
    float farthest;    // depth of its points
    float spacing;     // point spacing of its nearest node [px]; 0 without a point
};

// Returns a byte of one of the two words.
uint column_bits(uint left, uint right, uint column) {
    return (column < 4u ? left : right) >> (8u * (column % 4u)) & 255u;
}

// Appends a tile to the list that begins at a word of a buffer.
#define APPEND(list, at, tile) { \
    uint place = atomicAdd(list.word[(at) + 3u], 1u); \
    list.word[(at) + LIST_HEADER + place] = (tile); \
    list.word[(at) + 1u] = 1u; \
    list.word[(at) + 2u] = 1u; \
    atomicMax(list.word[at], min(place / TILES_PER_GROUP + 1u, MOST_GROUPS)); \
}

// Runs `work` for every tile of a list, with its place in it; local_size_x = 64.
//
// Loops are tested at their ends, here and wherever time matters: lavapipe executes the body of one
// tested at its beginning once more, with all lanes off. It also executes branches that no lane
// takes.
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

// Runs `work` for pixels of listed tiles, or for texels of `rows` rows of pixels, also for some
// beyond the picture's edges; `tile_at` returns column and row of the tile at a place of the list.
// A workgroup takes eight tiles at a time, eight lanes a row of each, one tile after the other:
// adjacent lanes read adjacent pixels of what is mostly a row of tiles, in the order of a pass over
// the whole picture. Column by column and tile by tile costs a software device a quarter more.
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

// Returns the top pixel of this lane's column.
ivec2 column_of(uint tile, uint tiles_across) {
    return tile_corner(tile, tiles_across) + ivec2(gl_LocalInvocationID.x % 8u, 0);
}
