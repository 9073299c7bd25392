// Verdicts on pixels without a point -> the same, with smooth contours.
//
// Levels judge squares of pixels one by one (visibility_levels.comp): contours between open and
// closed ones go in steps, and near the limit neighbours differ by chance. So each pixel takes the
// verdict of the majority around it, of those within three quarters of its square's side. Steps
// become slopes, squares in the middle of an opening do not float there, gaps have no pinholes, and
// strips as wide as a square stay as they are. Pixels that no level has decided are open, by the
// coarsest level. Those that the finest level has closed do not vote, since gaps beside dense
// points say nothing about openings.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "tile.glsl"

layout(local_size_x = 64) in;

layout(scalar) readonly buffer Tiles { Tile tile[]; } tiles;
// Three words per tile: two of pixels to judge, and one of levels that have.
layout(scalar) readonly buffer Asked { uint word[]; } asked;
// Hidden pixels or holes, two words per tile.
layout(scalar) buffer Invisible { uint word[]; } invisible;
// Pixels without a point that each level has decided, two words per tile and level; those of level
// 0 are decided by any level, and those after the last level turn.
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

// Returns the pixels of a tile that levels have judged, and none has decided.
uvec2 undecided(uint tile) {
    return uvec2(asked.word[3u * tile], asked.word[3u * tile + 1u]) & ~decided_by(tile, 0, 1);
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
    if ((undecided(number) | decided_by(number, 0, 1)) == uvec2(0u)) return uvec2(0u);
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
        bool coarsest = push.levels > first && push.levels <= end;
        squares |= coarsest ? undecided(number) : uvec2(0u);
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

// Counts the votes on a tile, and records the pixels that turn.
void count(uint number) {
    uvec2 turns = turned(number);
    uint word = uint(push.levels) * push.stride + 2u * number;
    decided.word[word] = turns.x;
    decided.word[word + 1u] = turns.y;
}

// Turns the recorded pixels of a tile. Several lanes may try; one gets each half of the tile.
void turn(uint number) {
    uint word = uint(push.levels) * push.stride + 2u * number;
    uvec2 turns = uvec2(atomicExchange(decided.word[word], 0u), atomicExchange(decided.word[word + 1u], 0u));
    if (turns == uvec2(0u)) return;
    uvec2 before = uvec2(atomicXor(invisible.word[2u * number], turns.x), atomicXor(invisible.word[2u * number + 1u], turns.y));
    uvec2 closes = turns & ~before;
    if (closes == uvec2(0u)) return;
    int level = push.levels - 1;
    uvec2 by_coarsest = undecided(number);
    [[dont_unroll]] while (level > 1 && ((decided_by(number, level, level + 1) | by_coarsest) & closes) == uvec2(0u)) --level;
    if (atomicCompSwap(kernels.tile[number], 0u, push.kernel << level) == 0u) APPEND(holes, 0u, number)
}

// Votes on a tile, and on those beside it that no level has looked at.
void vote(uint number) {
    ivec2 tile = ivec2(number % push.tiles.x, number / push.tiles.x);
    [[dont_unroll]] for (int n = 0; n < 9; ++n) {
        ivec2 at = tile + ivec2(n % 3 - 1, n / 3 - 1);
        if (any(lessThan(at, ivec2(0))) || any(greaterThanEqual(at, ivec2(push.tiles)))) continue;
        uint beside = uint(at.y) * push.tiles.x + uint(at.x);
        if (n != 4 && asked.word[3u * beside + 2u] != 0u) continue;
        if (TURN) turn(beside);
        else count(beside);
    }
}

void main() {
    uint end = lists.word[push.at + 3u];
    uint n = gl_GlobalInvocationID.x;
    if (n < end) for (;;) {
        vote(lists.word[push.at + LIST_HEADER + n]);
        n += 64u * gl_NumWorkGroups.x;
        if (n >= end) break;
    }
}
