// One level of the pyramid judges what finer ones have left: which points are hidden, or which
// pixels without a point are holes.
//
// A level reads the nearest points of the cells in its kernel. Those in front ("leading") close
// cones: for a pixel with a point, those nearer to the camera than its own surface may be; for one
// without, all.
//
//   open     the open area around the pixel would hold enough leading points that its being empty is
//            no chance: lambda A >= `expected`
//   closed   the remaining cones add up to less than `threshold` (Pintus et al. 2011, sec. 4), or to
//            less than `holes`
//   else     this level is too fine for the surface in front: the next coarser one judges. With too
//            few leading points for either, cones are not computed.
//
// For a pixel with a point, lambda is the number of leading points per cell, from the share p of
// the neighbours of leading cells that lead, too: -ln(1 - p), or nearly p / sqrt(1 - p); or p / a
// if that is more. Here a is the mean, over the sectors' nearest points, of the area for each pixel
// with a point of the nearest surface in their cells. Lambda is the density of the surface in front
// alone, whatever shows behind it. A is made of eight sectors, each up to its nearest leading point
// or to the rim of the kernel. So a dense surface is judged at a fine level, and its openings stay
// open at any size; a sparse one at a coarser level, where its points are about a cell apart. What
// looks out between dense posts is open at a coarse level, too, since a is small there.
//
// A cone is open beyond the hemisphere if all points of its sector lie beyond the plane across the
// ray. So a plane leaves 2 pi, however it is tilted, and a straight edge in front of it pi.
//
// A pixel without a point lies between surfaces whose densities may differ. The density around each
// sector's nearest point is the share of pixels with a point in 2 x 2 cells, of which an edge may
// leave a quarter. A sparse surface may reach up to the edge of a denser one. So no sector counts
// with a density that at least three others cannot have, but each with that of the sparsest surface
// at least: strays are none. A sector without a point tells nothing, and
// the widest of all eight does not count. The pixel is open only where too few sectors are empty
// for background: a finer level sees one side of a gap, and cannot tell it from the edge of a
// surface.
//
// Cones are those of visibility.comp, which has the geometry. Sectors follow from the places of
// points in their cells, since a cell may lie in several.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "tile.glsl"
#include "pixel.glsl"
#include "depth_pyramid.glsl"

layout(local_size_x = 64) in;

layout(r32f) readonly uniform image2D depth;
layout(rgba32f) readonly uniform image2D pyramid;
// Three words per tile: two of pixels to judge, and one with a bit for each level that must judge
// them.
layout(scalar) readonly buffer Asked { uint word[]; } asked;
layout(r32ui) readonly uniform uimageBuffer asked_words;
layout(scalar) readonly buffer Lists { uint word[]; } lists;
layout(r32ui) readonly uniform uimageBuffer listed_words;
// List of tiles with invisible pixels.
layout(scalar) buffer Holes { uint word[]; } holes;
// Points that the levels so far have left: column, and row in the upper 16 bits. Each level reads
// those of the one before and leaves its own to the next.
layout(scalar) readonly buffer From { uint pixel[]; } from;
layout(r32ui) readonly uniform uimageBuffer from_words;
layout(scalar) writeonly buffer To { uint pixel[]; } to;
// Four words per level: indirect dispatch over the points left to it, and their number.
layout(scalar) buffer Counts { uint word[]; } counts;
// Pixels without a point that the level has decided, two words per tile and level; those of level 0
// are decided by any. Each level reads what those before it wrote.
layout(scalar) buffer Decided { uint word[]; } decided;
layout(r32ui) readonly uniform uimageBuffer decided_words;
// Hidden pixels or holes, two words per tile.
layout(scalar) buffer Invisible { uint word[]; } invisible;
// Points with something in front, two words per tile.
layout(scalar) buffer Led { uint word[]; } led;
// Width of the kernel that put a tile on the list of holes [px]; 0 for other tiles.
layout(scalar) buffer Kernels { uint tile[]; } kernels;

layout(constant_id = 0) const uint RADIUS = 3u;
layout(constant_id = 1) const bool PERSPECTIVE = true;
// True if pixels without a point are judged.
layout(constant_id = 2) const bool EMPTY = false;
layout(constant_id = 3) const bool TEXELS = true;

layout(push_constant, scalar) uniform Push {
    uvec2 size;        // pixels
    vec2 centre;       // principal point [px]
    uint tiles_across;
    uint crossed;      // bits of edges beyond which surfaces continue: left, right, upper, lower
    int level;
    uint at;           // the list of this level
    uint stride;       // words from level to level of `decided`
    float px_per_unit;
    float closed;      // solid angle in sectors' hemispheres, below which a pixel is invisible
    int fewest;        // smallest number of leading points that decides anything
    float expected;    // points
    float least_density; // points per pixel, on the sparsest surface
    float own_slope;   // t t of the steepest own surface
} push;

const float FARTHEST = 3.402823466e38;
// Depths are clamped to this range, so that squares neither overflow nor vanish.
const float NEAREST_PLACE = 1e-15;
const float FARTHEST_PLACE = 1e15;

// How much higher a density may be than 2 x 2 cells at an edge say.
const float AT_EDGE = 4.0;

const int R = int(RADIUS);
const int WIDTH = 2 * R + 1;
const int MOST_WIDTH = 15;

// Returns the eighth of a turn from the x axis that an offset lies in; each has its first border.
int sector_of(vec2 offset) {
    bool upper = offset.y > 0.0 || (offset.y == 0.0 && offset.x > 0.0);
    int quarter = upper ? (offset.x > 0.0 ? 0 : 1) : (offset.x < 0.0 ? 2 : 3);
    vec2 along = quarter % 2 == 0 ? abs(offset) : abs(offset.yx);
    return 2 * quarter + int(along.y >= along.x);
}

// Returns whether a point of a cell may lie in a sector, seen from anywhere in the middle cell.
bool may_lie(ivec2 cell, int sector) {
    int quarter = sector / 2;
    ivec2 turned = quarter == 0 ? cell : quarter == 1 ? ivec2(cell.y, -cell.x) : quarter == 2 ? -cell : ivec2(-cell.y, cell.x);
    turned = sector % 2 == 0 ? turned : turned.yx;
    return turned.y + 1 >= 0 && turned.x + 1 >= max(turned.y - 1, 0);
}

// Judges a pixel without a point by the nearest in each sector: squared distances [px], and cells.
uint between(float nearest[8], uint nearest_in[8]) {
    ivec2 size = ivec2(push.size);
    ivec2 corner = level_corner(size, push.level + 1);
    int across = 2 << push.level;
    float densities[8];
    // The three lowest densities, in order.
    vec3 lowest = vec3(FARTHEST);
    [[unroll]] for (int s = 0; s < 8; ++s) {
        densities[s] = FARTHEST;
        if (nearest[s] == FARTHEST) continue;
        ivec2 around = ivec2(nearest_in[s] & 0xFFFFu, nearest_in[s] >> 16) >> 1;
        vec2 inside = vec2(min(ivec2(across), size - across * around));
        float share = min(imageLoad(pyramid, corner + around).a / (inside.x * inside.y), MOST_SHARE);
        densities[s] = share * inversesqrt(1.0 - share);
        lowest = vec3(min(lowest.x, densities[s]), min(lowest.yz, max(lowest.xy, vec2(densities[s]))));
    }
    int found = 0;
    // The points in the widest sector, and in all others.
    float widest = 0.0;
    float others = 0.0;
    [[unroll]] for (int s = 0; s < 8; ++s) {
        if (nearest[s] == FARTHEST) continue;
        float expected = max(min(densities[s], AT_EDGE * lowest.z), push.least_density) * nearest[s] * EIGHTH_OF_DISC;
        others += min(expected, widest);
        widest = max(expected, widest);
        ++found;
    }
    float expected = found == 8 ? others : others + widest;
    return found < push.fewest ? TOO_FEW : expected >= push.expected ? OPEN : CLOSED;
}

// Returns t |t| of the slope t towards the camera from a pixel's place to another point.
float rise(vec2 offset, vec2 ray, float z, float z0, float f_rr) {
    float square = offset.x * offset.x + offset.y * offset.y;
    float twist = offset.x * ray.y - offset.y * ray.x;
    float along = (z0 - z) * f_rr - (PERSPECTIVE ? z * (offset.x * ray.x + offset.y * ray.y) : 0.0);
    float across = PERSPECTIVE ? z * z * (square + twist * twist) : square;
    return along * abs(along) / across;
}

// Judges from the middle of a square of pixels, by its first pixel and its side.
uint judge(ivec2 pixel, int across) {
    ivec2 size = ivec2(push.size);
    ivec2 cells = level_size(size, push.level);
    ivec2 corner = level_corner(size, push.level);
    ivec2 cell = pixel >> push.level;
    float side = float(1 << push.level);
    vec2 at = vec2(pixel) + 0.5 * float(across);
    float own = imageLoad(depth, pixel).r;
    vec2 ray = (at - push.centre) / push.px_per_unit;
    float farthest = PERSPECTIVE ? FARTHEST_PLACE : FARTHEST_PLACE / push.px_per_unit;
    float z0 = clamp(own, NEAREST_PLACE, farthest);
    float f_rr = PERSPECTIVE ? push.px_per_unit * (1.0 + ray.x * ray.x + ray.y * ray.y) : push.px_per_unit;
    int columns[MOST_WIDTH];
    uint may = 0u;
    [[unroll]] for (int dx = -R; dx <= R; ++dx) {
        columns[dx + R] = at_edge(cell.x + dx, cells.x);
        may |= may_hold(cell.x + dx, cells.x, push.crossed) ? 1u << (dx + R) : 0u;
    }
    // The cells with a point elsewhere, and the leading ones, which most pixels have too few of.
    uint held[MOST_WIDTH];
    uint rows[MOST_WIDTH];
    int leaders = 0;
    [[unroll]] for (int dy = -R; dy <= R; ++dy) {
        int y = at_edge(cell.y + dy, cells.y);
        held[dy + R] = 0u;
        rows[dy + R] = 0u;
        [[unroll]] for (int dx = -R; dx <= R; ++dx) {
            vec4 texel = imageLoad(pyramid, corner + ivec2(columns[dx + R], y));
            bool holds = texel.a > 0.0;
            bool leads = holds;
            if (!EMPTY) {
                vec2 offset = place_in(cell + ivec2(dx, dy), push.level, texel) - at;
                float z = clamp(texel.r, NEAREST_PLACE, farthest);
                holds = holds && offset != vec2(0.0);
                leads = holds && z < z0 && rise(offset, ray, z, z0, f_rr) > push.own_slope;
            }
            held[dy + R] |= holds ? 1u << (dx + R) : 0u;
            rows[dy + R] |= leads ? 1u << (dx + R) : 0u;
        }
        uint may_here = may_hold(cell.y + dy, cells.y, push.crossed >> 2) ? may : 0u;
        held[dy + R] &= may_here;
        rows[dy + R] &= may_here;
        leaders += bitCount(rows[dy + R]);
    }
    if (leaders < push.fewest) return TOO_FEW;
    float rim = (float(R) + 0.5) * side;
    float most[8];
    float nearest[8];
    // Pixels of the nearest surface in the cell of the nearest point.
    float fronts[8];
    // Cells of the nearest points: column, and row in the upper 16 bits.
    uint nearest_in[8];
    [[unroll]] for (int s = 0; s < 8; ++s) {
        most[s] = NOTHING;
        nearest[s] = FARTHEST;
        fronts[s] = 1.0;
        nearest_in[s] = 0u;
    }
    [[unroll]] for (int dy = -R; dy <= R; ++dy) {
        int y = at_edge(cell.y + dy, cells.y);
        [[unroll]] for (int dx = -R; dx <= R; ++dx) {
            ivec2 from = ivec2(columns[dx + R], y);
            vec4 texel = imageLoad(pyramid, corner + from);
            vec2 offset = place_in(cell + ivec2(dx, dy), push.level, texel) - at;
            bool leads = (rows[dy + R] >> (dx + R) & 1u) == 1u;
            bool holds = (held[dy + R] >> (dx + R) & 1u) == 1u;
            float z = clamp(texel.r, NEAREST_PLACE, farthest);
            float ratio = holds && !EMPTY ? rise(offset, ray, z, z0, f_rr) : NOTHING;
            ratio = leads ? ratio : min(ratio, 0.0);
            float square = leads ? offset.x * offset.x + offset.y * offset.y : FARTHEST;
            int sector = sector_of(offset);
            [[unroll]] for (int s = 0; s < 8; ++s) {
                if (!may_lie(ivec2(dx, dy), s)) continue;
                bool here = sector == s;
                most[s] = here ? max(most[s], ratio) : most[s];
                if (!EMPTY) fronts[s] = here && square < nearest[s] ? texel.b : fronts[s];
                if (EMPTY) nearest_in[s] = here && square < nearest[s] ? uint(from.x) | uint(from.y) << 16 : nearest_in[s];
                nearest[s] = here ? min(nearest[s], square) : nearest[s];
            }
        }
    }
    if (EMPTY) return between(nearest, nearest_in);
    // Neighbours of leading cells within the kernel, and those of them that lead.
    const uint EDGES = 1u | 1u << (WIDTH - 1);
    int neighbours = 0;
    int pairs = 0;
    [[unroll]] for (int y = 0; y < WIDTH; ++y) {
        int tall = y == 0 || y == WIDTH - 1 ? 2 : 3;
        neighbours += (3 * tall - 1) * bitCount(rows[y]) - tall * bitCount(rows[y] & EDGES);
        pairs += bitCount(rows[y] & rows[y] >> 1);
        if (y > 0) pairs += bitCount(rows[y] & rows[y - 1]) + bitCount(rows[y] & rows[y - 1] >> 1) + bitCount(rows[y] >> 1 & rows[y - 1]);
    }
    float squares = 0.0;
    float cones = 0.0;
    float areas = 0.0;
    int found = 0;
    [[unroll]] for (int s = 0; s < 8; ++s) {
        squares += min(nearest[s], rim * rim);
        cones += cone(most[s]);
        areas += nearest[s] < FARTHEST ? 1.0 / fronts[s] : 0.0;
        found += nearest[s] < FARTHEST ? 1 : 0;
    }
    return verdict(leaders, areas / float(found), push.fewest, pairs, neighbours, squares / (side * side), cones, push.closed, push.expected);
}

// Returns the first pixel of those that are left: numbers run down a column, then down the next.
int first_of(uvec2 bits) {
    return bits.x != 0u ? findLSB(bits.x) : 32 + findLSB(bits.y);
}

uvec2 without_first(uvec2 bits) {
    return bits.x != 0u ? uvec2(bits.x & (bits.x - 1u), bits.y) : uvec2(0u, bits.y & (bits.y - 1u));
}

// Returns the pixels of a square, by its first pixel and its side.
uvec2 square_at(int first, int across) {
    uvec2 bits = uvec2(0u);
    uint column = ((1u << across) - 1u) << (first % 8);
    [[dont_unroll]] for (int x = first / 8; x < first / 8 + across; ++x) {
        bits.x |= x < 4 ? column << (8 * x) : 0u;
        bits.y |= x < 4 ? 0u : column << (8 * (x - 4));
    }
    return bits;
}

// Records what has been found of pixels of a tile.
void keep(uint tile, uvec2 closed, uvec2 leads) {
    [[unroll]] for (int half_tile = 0; half_tile < 2; ++half_tile) {
        uint word = 2u * tile + uint(half_tile);
        if (closed[half_tile] != 0u) atomicOr(invisible.word[word], closed[half_tile]);
        if (!EMPTY && leads[half_tile] != 0u) atomicOr(led.word[word], leads[half_tile]);
    }
    uint width = uint(WIDTH) << push.level;
    if (closed != uvec2(0u) && atomicExchange(kernels.tile[tile], width) == 0u) APPEND(holes, 0u, tile)
}

// Judges all pixels of a tile that are asked for. Several lanes share it, and take them in turn.
//
// Pixels without a point are taken by squares half a cell wide, of 2 to 8 pixels, from whose middle
// the level looks nearly the same.
void judge_tile(uint n, uint lane, uint lanes) {
    uint tile = WORD(listed_words, lists, push.at + LIST_HEADER + n);
    uvec2 pixels = uvec2(WORD(asked_words, asked, 3u * tile), WORD(asked_words, asked, 3u * tile + 1u));
    [[dont_unroll]] for (int level = 1; level < push.level; ++level) {
        uint word = uint(level) * push.stride + 2u * tile;
        pixels &= ~uvec2(WORD(decided_words, decided, word), WORD(decided_words, decided, word + 1u));
    }
    uvec2 left = pixels;
    int across = clamp(1 << push.level >> 1, 2, TILE_PX);
    [[dont_unroll]] for (int first = 0; first < 64; first += first % 8 + across < 8 ? across : 8 * across - first % 8) {
        uvec2 square = square_at(first, across);
        bool any = (square & pixels) != uvec2(0u);
        left = (left & ~square) | (any ? square_at(first, 1) : uvec2(0u));
    }
    ivec2 corner = tile_corner(tile, push.tiles_across);
    [[dont_unroll]] for (uint skipped = 0u; skipped < lane; ++skipped) left = without_first(left);
    uvec2 settled = uvec2(0u);
    uvec2 closed = uvec2(0u);
    if (left != uvec2(0u)) for (;;) {
        int first = first_of(left);
        uint said = judge(corner + ivec2(first / 8, first % 8), across);
        uvec2 square = square_at(first, across) & pixels;
        settled |= said == OPEN || said == CLOSED ? square : uvec2(0u);
        closed |= said == CLOSED ? square : uvec2(0u);
        [[dont_unroll]] for (uint skipped = 0u; skipped < lanes; ++skipped) left = without_first(left);
        if (left == uvec2(0u)) break;
    }
    keep(tile, closed, uvec2(0u));
    [[unroll]] for (int half_tile = 0; half_tile < 2; ++half_tile) {
        uint word = 2u * tile + uint(half_tile);
        if (settled[half_tile] == 0u) continue;
        atomicOr(decided.word[word], settled[half_tile]);
        atomicOr(decided.word[uint(push.level) * push.stride + word], settled[half_tile]);
    }
}

// Judges a point that finer levels have left.
void judge_point(uint n) {
    uint entry = WORD_OF(from_words, from.pixel, n);
    ivec2 pixel = ivec2(entry & 0xFFFFu, entry >> 16);
    ivec2 at = pixel % TILE_PX;
    uint tile = uint(pixel.y / TILE_PX) * push.tiles_across + uint(pixel.x / TILE_PX);
    uint levels = WORD(asked_words, asked, 3u * tile + 2u);
    uint said = (levels >> push.level & 1u) == 1u ? judge(pixel, 1) : TOO_FEW;
    uvec2 bits = square_at(8 * at.x + at.y, 1);
    keep(tile, said == CLOSED ? bits : uvec2(0u), said != TOO_FEW ? bits : uvec2(0u));
    if ((said == TOO_FEW || said == UNDECIDED) && levels >> (push.level + 1) != 0u) {
        uint place;
        LEAVE(counts, push.level + 1, 1u, place)
        to.pixel[place] = entry;
    }
}

void main() {
    uint lanes = !EMPTY ? 1u : push.level < 3 ? 8u : push.level < 4 ? 4u : 1u;
    uint end = EMPTY ? WORD(listed_words, lists, push.at + 3u) : counts.word[4u * uint(push.level) + 3u];
    uint n = (64u * gl_WorkGroupID.x + gl_LocalInvocationID.x) / lanes;
    if (n < end) for (;;) {
        if (EMPTY) judge_tile(n, gl_LocalInvocationID.x % lanes, lanes);
        else judge_point(n);
        n += 64u / lanes * gl_NumWorkGroups.x;
        if (n >= end) break;
    }
}
