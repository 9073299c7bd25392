// Verdicts on pixels without a point -> the same, but for those that chance has left alone.
//
// Levels judge squares of pixels one by one (visibility_levels.comp), and near the limit neighbours
// differ by chance. A square takes the verdict of the majority of itself and the four squares of its
// size beside it, of those that have one: squares in the middle of an opening do not float there,
// and gaps have no pinholes. Pixels that the finest level has closed do not vote, since gaps beside
// dense points say nothing about openings.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "tile.glsl"

layout(local_size_x = 64) in;

// Hidden pixels or holes, two words per tile.
layout(scalar) buffer Invisible { uint word[]; } invisible;
// Pixels without a point that each level has decided, two words per tile and level; those of level 0
// are the pixels that turn.
layout(scalar) buffer Decided { uint word[]; } decided;
layout(scalar) readonly buffer Lists { uint word[]; } lists;
// List of tiles with invisible pixels.
layout(scalar) buffer Holes { uint word[]; } holes;
// Width of the kernel that put a tile on the list of holes [px]; 0 for other tiles.
layout(scalar) buffer Kernels { uint tile[]; } kernels;

// Turns verdicts after all votes are counted; otherwise counts.
layout(constant_id = 0) const bool TURN = false;

layout(push_constant, scalar) uniform Push {
    uvec2 tiles;
    uint stride; // words from level to level of `decided`
    int levels;
    uint kernel; // width [cells]
    uint at;     // list of the tiles that any level has judged
} push;

// Pixels of a tile, as bits (lib/tile.glsl), by verdict.
struct Verdicts {
    uvec2 closed;
    uvec2 open;
};

// Returns the pixels that levels of a range have decided.
uvec2 decided_by(uint tile, int first, int end) {
    uvec2 bits = uvec2(0u);
    [[dont_unroll]] for (int level = first; level < end; ++level) {
        uint word = uint(level) * push.stride + 2u * tile;
        bits |= uvec2(decided.word[word], decided.word[word + 1u]);
    }
    return bits;
}

// Returns the verdicts on a tile; none outside.
Verdicts verdicts_at(ivec2 tile) {
    ivec2 tiles = ivec2(push.tiles);
    bool inside = all(greaterThanEqual(tile, ivec2(0))) && all(lessThan(tile, tiles));
    tile = clamp(tile, ivec2(0), tiles - 1);
    uint number = uint(tile.y * tiles.x + tile.x);
    uvec2 all_bits = inside ? decided_by(number, 1, push.levels) : uvec2(0u);
    uvec2 closed = uvec2(invisible.word[2u * number], invisible.word[2u * number + 1u]);
    return Verdicts(all_bits & closed, all_bits & ~closed);
}

// Moves pixels down by a number of rows, those of the tile above into it.
uvec2 from_above(uvec2 own, uvec2 above, int rows) {
    uint kept = ((1u << (8 - rows)) - 1u) * 0x01010101u;
    return rows == 8 ? above : (own & kept) << rows | (above >> (8 - rows)) & ~(kept << rows);
}

uvec2 from_below(uvec2 own, uvec2 below, int rows) {
    uint moved = ((1u << rows) - 1u) * 0x01010101u;
    return rows == 8 ? below : (own >> rows) & ~(moved << (8 - rows)) | (below & moved) << (8 - rows);
}

// Moves pixels to the right by 2, 4 or 8 columns, those of the tile to the left into it.
uvec2 from_left(uvec2 own, uvec2 left, int columns) {
    uvec2 by_two = uvec2(own.x << 16 | left.y >> 16, own.y << 16 | own.x >> 16);
    return columns == 8 ? left : columns == 4 ? uvec2(left.y, own.x) : by_two;
}

uvec2 from_right(uvec2 own, uvec2 right, int columns) {
    uvec2 by_two = uvec2(own.x >> 16 | own.y << 16, own.y >> 16 | right.x << 16);
    return columns == 8 ? right : columns == 4 ? uvec2(own.y, right.x) : by_two;
}

// Returns where at least two more of four vote against than for.
uvec2 outvoted(uvec2 against[4], uvec2 by[4]) {
    uvec2 first = against[0] & against[1];
    uvec2 second = against[2] & against[3];
    uvec2 one_of_first = against[0] | against[1];
    uvec2 one_of_second = against[2] | against[3];
    uvec2 two = first | second | one_of_first & one_of_second;
    uvec2 three = first & one_of_second | second & one_of_first;
    return three | two & ~(by[0] | by[1] | by[2] | by[3]);
}

// Returns the pixels of a tile whose verdict turns.
uvec2 turned(uint number) {
    ivec2 tile = ivec2(number % push.tiles.x, number / push.tiles.x);
    Verdicts own = verdicts_at(tile);
    Verdicts above = verdicts_at(tile - ivec2(0, 1));
    Verdicts below = verdicts_at(tile + ivec2(0, 1));
    Verdicts left = verdicts_at(tile - ivec2(1, 0));
    Verdicts right = verdicts_at(tile + ivec2(1, 0));
    uvec2 turns = uvec2(0u);
    [[dont_unroll]] for (int across = 2; across <= TILE_PX; across *= 2) {
        int first = across == 2 ? 1 : across == 4 ? 3 : 4;
        int end = across == 2 ? 3 : across == 4 ? 4 : push.levels;
        uvec2 squares = decided_by(number, first, min(end, push.levels));
        uvec2 closed[4] = uvec2[4](from_above(own.closed, above.closed, across), from_below(own.closed, below.closed, across), from_left(own.closed, left.closed, across), from_right(own.closed, right.closed, across));
        uvec2 open[4] = uvec2[4](from_above(own.open, above.open, across), from_below(own.open, below.open, across), from_left(own.open, left.open, across), from_right(own.open, right.open, across));
        turns |= squares & (own.open & outvoted(closed, open) | own.closed & outvoted(open, closed));
    }
    return turns;
}

void count(uint number) {
    uvec2 turns = turned(number);
    decided.word[2u * number] = turns.x;
    decided.word[2u * number + 1u] = turns.y;
}

void turn(uint number) {
    uvec2 turns = decided_by(number, 0, 1);
    uvec2 before = uvec2(invisible.word[2u * number], invisible.word[2u * number + 1u]);
    invisible.word[2u * number] = before.x ^ turns.x;
    invisible.word[2u * number + 1u] = before.y ^ turns.y;
    if ((turns & ~before) == uvec2(0u) || kernels.tile[number] != 0u) return;
    int level = push.levels - 1;
    [[dont_unroll]] while (level > 1 && (decided_by(number, level, level + 1) & turns & ~before) == uvec2(0u)) --level;
    kernels.tile[number] = push.kernel << level;
    APPEND(holes, 0u, number)
}

void main() {
    uint end = lists.word[push.at + 3u];
    uint n = gl_GlobalInvocationID.x;
    if (n < end) for (;;) {
        uint number = lists.word[push.at + LIST_HEADER + n];
        if (TURN) turn(number);
        else count(number);
        n += 64u * gl_NumWorkGroups.x;
        if (n >= end) break;
    }
}
