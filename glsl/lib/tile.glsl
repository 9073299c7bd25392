// Tiles of 8 x 8 pixels: what is known of one, and lists of those that a pass is to work on. Declares no bindings.
//
// A list is words in a buffer, from a place `at` on: three words of an indirect dispatch, the number of tiles, then the tiles. It starts as zeros.
// Workgroups take tile after tile, so that a list may be longer than the 65,535 workgroups that every device dispatches.

const int TILE_PX = 8;
const uint LIST_HEADER = 4u;
const uint MOST_GROUPS = 65535u;

// Of the buffer `invisible`: a bit a pixel, and 1 where any is set.
const uint WORDS_PER_TILE = 3u;

struct Tile {
    uint points;     // pixels that hold one
    uint continuous; // 1: every pixel does, and neighbours differ by less than a hidden layer would
    float nearest;   // depths; infinite where no point is
    float farthest;  // 0 where no point is
};

// The includer has a buffer `lists` of words.
#define APPEND(at, tile) { \
    uint place = atomicAdd(lists.word[(at) + 3u], 1u); \
    lists.word[(at) + LIST_HEADER + place] = (tile); \
    lists.word[(at) + 1u] = 1u; \
    lists.word[(at) + 2u] = 1u; \
    atomicMax(lists.word[at], min(place + 1u, MOST_GROUPS)); \
}

ivec2 tile_corner(uint tile, uint tiles_across) {
    return ivec2(tile % tiles_across, tile / tiles_across) * TILE_PX;
}

// Points that lie beyond the picture's edge are not known; the pixels inside stand for them as in a mirror, so that a hole at the edge is like any other.
ivec2 mirrored(ivec2 pixel, ivec2 size) {
    ivec2 folded = size - 1 - abs(size - 1 - abs(pixel));
    return clamp(folded, ivec2(0), size - 1);
}
