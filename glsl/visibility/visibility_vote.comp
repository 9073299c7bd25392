// Verdicts on pixels without a point -> the same, with smooth contours.
//
// Levels judge squares of pixels one by one (visibility_levels.comp): contours between open and
// closed ones go in steps, and near the limit neighbours differ by chance. So each pixel takes the
// verdict of the majority around it, of those within three quarters of its square's side. Steps
// become slopes, squares in the middle of an opening do not float there, gaps have no pinholes, and
// strips as wide as a square stay as they are. Pixels that no level has decided are open. Those that
// the finest level has closed do not vote, since gaps beside dense points say nothing about openings.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "tile.glsl"

layout(local_size_x = 64) in;

layout(scalar) readonly buffer Tiles { Tile tile[]; } tiles;
// Hidden pixels or holes, two words per tile.
layout(scalar) buffer Invisible { uint word[]; } invisible;
// Pixels without a point that each level has decided, two words per tile and level; those of level 0
// are decided by any level, and those after the last level turn.
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
    ivec2 across = ivec2(push.tiles);
    bool inside = all(greaterThanEqual(tile, ivec2(0))) && all(lessThan(tile, across));
    tile = clamp(tile, ivec2(0), across - 1);
    uint number = uint(tile.y * across.x + tile.x);
    uvec2 empty = inside ? uvec2(tiles.tile[number].empty_left, tiles.tile[number].empty_right) : uvec2(0u);
    uvec2 closed = uvec2(invisible.word[2u * number], invisible.word[2u * number + 1u]);
    return Verdicts(empty & closed & decided_by(number, 0, 1), empty & ~closed);
}

// Pixels around a tile that may vote on its own [px].
const int AROUND = 6;
const int COLUMNS = TILE_PX + 2 * AROUND;

// Returns the pixels of a tile whose verdict turns.
uvec2 turned(uint number) {
    ivec2 tile = ivec2(number % push.tiles.x, number / push.tiles.x);
    Verdicts own = verdicts_at(tile);
    // Columns of three tiles, bits from the upper one's first row on.
    uint closed[COLUMNS];
    uint open[COLUMNS];
    uvec2 any = uvec2(0u);
    [[unroll]] for (int column = 0; column < COLUMNS; ++column) closed[column] = open[column] = 0u;
    [[unroll]] for (int n = 0; n < 9; ++n) {
        Verdicts found = verdicts_at(tile + ivec2(n % 3 - 1, n / 3 - 1));
        any |= uvec2(found.closed.x | found.closed.y, found.open.x | found.open.y);
        [[unroll]] for (int x = 0; x < TILE_PX; ++x) {
            int column = TILE_PX * (n % 3 - 1) + x + AROUND;
            if (column < 0 || column >= COLUMNS) continue;
            closed[column] |= (found.closed[x / 4] >> 8 * (x % 4) & 0xFFu) << 8 * (n / 3);
            open[column] |= (found.open[x / 4] >> 8 * (x % 4) & 0xFFu) << 8 * (n / 3);
        }
    }
    if (any.x == 0u || any.y == 0u) return uvec2(0u);
    uvec2 turns = uvec2(0u);
    [[dont_unroll]] for (int across = 2; across <= TILE_PX; across *= 2) {
        int first = across == 2 ? 1 : across == 4 ? 3 : 4;
        int end = across == 2 ? 3 : across == 4 ? 4 : push.levels;
        uvec2 squares = decided_by(number, first, min(end, push.levels));
        if (squares == uvec2(0u)) continue;
        int reach = 3 * across / 4;
        [[dont_unroll]] for (int y = 0; y < TILE_PX; ++y) {
            uint rows = ((2u << 2 * reach) - 1u) << (TILE_PX + y - reach);
            int lead[COLUMNS];
            [[unroll]] for (int column = 0; column < COLUMNS; ++column) lead[column] = bitCount(closed[column] & rows) - bitCount(open[column] & rows);
            int sum = 0;
            [[dont_unroll]] for (int column = AROUND - reach; column < AROUND + reach; ++column) sum += lead[column];
            [[dont_unroll]] for (int x = 0; x < TILE_PX; ++x) {
                sum += lead[x + AROUND + reach];
                int word = x / 4;
                uint against = sum > 0 ? own.open[word] : sum < 0 ? own.closed[word] : 0u;
                turns[word] |= squares[word] & against & 1u << (8 * (x % 4) + y);
                sum -= lead[x + AROUND - reach];
            }
        }
    }
    return turns;
}

void count(uint number) {
    uvec2 turns = turned(number);
    uint word = uint(push.levels) * push.stride + 2u * number;
    decided.word[word] = turns.x;
    decided.word[word + 1u] = turns.y;
}

void turn(uint number) {
    uvec2 turns = decided_by(number, push.levels, push.levels + 1);
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
