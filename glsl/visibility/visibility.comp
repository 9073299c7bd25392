// Judges which pixels show a surface or background, and which a hidden layer or a hole, with a
// single kernel (Pintus et al. 2011, sec. 4; guide: papers); or as the finest level of a pyramid
// (visibility_levels.comp).
//
// Around the ray from the pixel's point p0 to the camera, every sector of the neighbourhood leaves
// an empty cone up to the neighbour nearest to the ray. The pixel is visible if the solid angles of
// the cones add up to `threshold`.
//
//   p0 - camera = z0 r0,  pi - camera = zi ri,  ri = r0 + (dx, dy, 0) / f
//   cotangent of the angle at p0 between the ray to the camera and that to pi:
//     t = ((z0 - zi) f r0.r0 - zi (d . r0)) / (zi sqrt(d.d + (d x r0)^2))
//   nothing cancels except z0 - zi, which is exact
//   share of a sector's hemisphere: 1 - cos = 1 - t / sqrt(1 + t t); 1 for a sector without a
//   neighbour, or if it may be of the pixel's own surface: 0 < t <= `own_slope`
// Only the largest t of a sector counts, so t |t| is compared, with one root per sector. A pixel
// without a point stands for one beyond all its neighbours: its cones are closed or hemispheres. A
// neighbour beyond the plane through p0 across the ray opens its cone beyond the hemisphere (t <
// 0).
//
// Sectors follow from integer offsets. Half of them lie to the right of the pixel or straight above
// it; the others are the same after half a turn, and so is the code. A lane takes four pixels of a
// column: their neighbourhoods overlap, and a texel of `packed_depth` holds four rows. The loop
// over columns is not unrolled, so that wide kernels compile fast.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "tile.glsl"
#include "depth_pyramid.glsl"

layout(local_size_x = 64) in;

layout(r32f) readonly uniform image2D depth;
layout(rgba32f) readonly uniform image2D packed_depth;
layout(scalar) readonly buffer Lists { uint word[]; } lists;
// List of tiles with invisible pixels.
layout(scalar) buffer Holes { uint word[]; } holes;
layout(r32ui) readonly uniform uimageBuffer listed_words;
// Two words per tile, one bit per pixel (lib/tile.glsl).
layout(scalar) buffer Invisible { uint word[]; } invisible;
// Width of the kernel that put each tile on that list [px]; 0 for others.
layout(scalar) buffer Kernels { uint tile[]; } kernels;
// Three words per tile of a pyramid: two of points to judge, one with a bit for each level that
// must judge them.
layout(scalar) readonly buffer Asked { uint word[]; } asked;
layout(r32ui) readonly uniform uimageBuffer asked_words;
// Points left to the next level: column, and row in the upper 16 bits.
layout(scalar) writeonly buffer To { uint pixel[]; } to;
// Four words per level: indirect dispatch over the points left to it, and their number.
layout(scalar) buffer Counts { uint word[]; } counts;
// Pixels without a point that are decided, two words per tile.
layout(scalar) buffer Decided { uint word[]; } decided;
// Points with enough points in front, two words per tile.
layout(scalar) buffer Led { uint word[]; } led;

layout(constant_id = 0) const uint RADIUS = 4u;
layout(constant_id = 1) const uint SECTORS = 8u;
layout(constant_id = 2) const bool PERSPECTIVE = true;
layout(constant_id = 3) const bool TEXELS = true;
// True if this is the finest level of a pyramid, not the paper's single kernel.
layout(constant_id = 4) const bool FINEST = false;

layout(push_constant, scalar) uniform Push {
    uvec2 size;        // pixels
    vec2 centre;       // principal point [px]
    uint tiles_across;
    uint at;           // the list
    uint empties;      // 1: pixels without a point are judged, too
    float px_per_unit;
    float threshold;   // steradians * SECTORS / 2 pi
    float hole;        // likewise for a pixel without a point
    float own_slope;   // t t of the steepest own surface
    float expected;    // points, for a pyramid
    ivec2 fewest;      // smallest number of leading points: for points, for empty pixels
} push;

const float FARTHEST = 3.402823466e38;
// Depths are clamped to this range, so that squares neither overflow nor vanish.
const float NEAREST_PLACE = 1e-15;
const float FARTHEST_PLACE = 1e15;
const int R = int(RADIUS);
// Texels above and below a lane's own, and pixels from the first of them to the lane's first.
const int REACH = (R + 3) / 4;
const int ABOVE = 4 * REACH;
const int MOST_ROWS = 20;
const int PER_QUARTER = int(SECTORS) / 4;
// Square of half the kernel's width.
#define RIM ((float(R) + 0.5) * (float(R) + 0.5))
const uint EDGES = 1u | 1u << (2 * R);

// Returns the sector of an offset within its quarter of the plane, which begins with an axis: 0 to
// PER_QUARTER - 1.
int sector_of(int along, int beside) {
    bool eighth = beside >= along;
    int shorter = eighth ? beside - along : along + beside;
    bool sixteenth = shorter * shorter > 2 * along * along;
    return SECTORS == 4u ? 0 : SECTORS == 8u ? int(eighth) : 2 * int(eighth) + int(sixteenth);
}

void work(uint n) {
    ivec2 size = ivec2(push.size);
    float farthest = PERSPECTIVE ? FARTHEST_PLACE : FARTHEST_PLACE / push.px_per_unit;
    uint tile = WORD(listed_words, lists, push.at + LIST_HEADER + n);
    ivec2 top = column_of(tile, push.tiles_across);
    uint column = gl_LocalInvocationID.x % 8u;
    uint points = FINEST ? column_bits(WORD(asked_words, asked, 3u * tile), WORD(asked_words, asked, 3u * tile + 1u), column) : 0u;
    uint bits = 0u;
    uint leading = 0u;
    uint left = 0u;
    uint settled = 0u;
    [[dont_unroll]] for (int half_tile = 0;; ++half_tile) {
        int first = top.y + 4 * half_tile;
        ivec2 texel = ivec2(top.x + MARGIN_PX, (first + MARGIN_PX) / 4);
        float ray_x = (float(top.x) + 0.5 - push.centre.x) / push.px_per_unit;
        vec4 ray_y, z0, f_rr, own;
        vec4 sum = vec4(0.0);
        vec4 squares = vec4(0.0);
        // Numbers of points in front, of their neighbours within the kernel, and of pairs in front.
        ivec4 leaders = ivec4(0);
        ivec4 neighbours = ivec4(0);
        ivec4 pairs = ivec4(0);
        [[unroll]] for (int p = 0; p < 4; ++p) {
            own[p] = imageLoad(depth, min(ivec2(top.x, first + p), size - 1)).r;
            ray_y[p] = (float(first + p) + 0.5 - push.centre.y) / push.px_per_unit;
            float rr = 1.0 + ray_x * ray_x + ray_y[p] * ray_y[p];
            f_rr[p] = PERSPECTIVE ? push.px_per_unit * rr : push.px_per_unit;
            z0[p] = clamp(own[p], NEAREST_PLACE, farthest);
        }
        [[dont_unroll]] for (int side = 1;; side = -1) {
            float most[32];
            float nearest[32];
            uvec4 before = uvec4(0u);
            [[unroll]] for (int s = 0; s < 32; ++s) {
                most[s] = NOTHING;
                nearest[s] = RIM;
            }
            [[dont_unroll]] for (int dx = 0;; ++dx) {
                // Depths of a column of neighbours of all four pixels, and the squares that scale
                // lengths, 0 without a point.
                float z[MOST_ROWS];
                float zz[MOST_ROWS];
                [[unroll]] for (int q = 0; q < 2 * REACH + 1; ++q) {
                    vec4 four = imageLoad(packed_depth, texel + side * ivec2(dx, q - REACH));
                    four = mix(four.wzyx, four, bvec4(side > 0));
                    [[unroll]] for (int c = 0; c < 4; ++c) {
                        float place = clamp(four[c], NEAREST_PLACE, farthest);
                        z[4 * q + c] = place;
                        zz[4 * q + c] = mix(0.0, PERSPECTIVE ? place * place : 1.0, four[c] > 0.0 && four[c] <= FARTHEST);
                    }
                }
                uvec4 leads = uvec4(0u);
                [[unroll]] for (int dy = -R; dy <= R; ++dy) {
                    // The half plane includes the axis above the pixel and not the one below.
                    int sector = dy < 0 ? sector_of(-dy, dx) : dx > 0 ? sector_of(dx, dy) : PER_QUARTER;
                    [[unroll]] for (int p = 0; p < 4; ++p) {
                        int i = ABOVE + p + dy;
                        float aside = float(dx) * ray_x + float(dy) * ray_y[p];
                        float twist = float(dx) * ray_y[p] - float(dy) * ray_x;
                        float along = (z0[p] - z[i]) * f_rr[p] - (PERSPECTIVE ? z[i] * aside : 0.0);
                        float across = zz[i] * (float(dx * dx + dy * dy) + (PERSPECTIVE ? twist * twist : 0.0));
                        float ratio = along * abs(along) / across;
                        bool leader = zz[i] > 0.0 && (own[p] > FARTHEST || ((z[i] < z0[p] || !FINEST) && ratio > push.own_slope));
                        float lean = mix(NOTHING, leader ? ratio : min(ratio, 0.0), zz[i] > 0.0);
                        if (FINEST) leads[p] |= leader && (dx > 0 || dy != 0) ? 1u << (dy + R) : 0u;
                        [[unroll]] for (int k = 0; k < PER_QUARTER; ++k) {
                            int s = 8 * p + (dy < 0 ? 0 : 4) + k;
                            most[s] = max(most[s], mix(NOTHING, lean, sector == k));
                            if (FINEST) nearest[s] = min(nearest[s], leader && sector == k ? float(dx * dx + dy * dy) : RIM);
                        }
                    }
                }
                // Pairs with the column before, and within this one; the middle column occurs
                // twice.
                if (FINEST) {
                    int wide = dx < R ? 3 : 2;
                    [[unroll]] for (int p = 0; p < 4; ++p) {
                        uint column = leads[p];
                        uint last = before[p];
                        bool first = dx > 0 || side > 0;
                        leaders[p] += first ? bitCount(column) : 0;
                        neighbours[p] += first ? (3 * wide - 1) * bitCount(column) - wide * bitCount(column & EDGES) : 0;
                        pairs[p] += first ? bitCount(column & column >> 1) : 0;
                        pairs[p] += bitCount(column & last) + bitCount(column & last >> 1) + bitCount(column >> 1 & last);
                        before[p] = column;
                    }
                }
                if (dx == R) break;
            }
            [[unroll]] for (int p = 0; p < 4; ++p) {
                [[unroll]] for (int k = 0; k < PER_QUARTER; ++k) {
                    bool empty = !(own[p] <= FARTHEST);
                    vec2 lean = vec2(most[8 * p + k], most[8 * p + 4 + k]);
                    // All points lie before a pixel without one.
                    sum[p] += empty ? float(lean.x <= NOTHING) + float(lean.y <= NOTHING) : cone(lean.x) + cone(lean.y);
                    if (FINEST) squares[p] += nearest[8 * p + k] + nearest[8 * p + 4 + k];
                }
            }
            // Half a turn.
            ray_x = -ray_x;
            ray_y = -ray_y.wzyx;
            f_rr = f_rr.wzyx;
            z0 = z0.wzyx;
            own = own.wzyx;
            sum = sum.wzyx;
            squares = squares.wzyx;
            leaders = leaders.wzyx;
            neighbours = neighbours.wzyx;
            pairs = pairs.wzyx;
            if (side < 0) break;
        }
        [[unroll]] for (int p = 0; p < 4; ++p) {
            bool inside = top.x < size.x && first + p < size.y;
            bool empty = !(own[p] <= FARTHEST);
            float closed = empty ? push.hole : push.threshold;
            uint bit = 1u << (4 * half_tile + p);
            // The kernel is too small for openings between surfaces (visibility_levels.comp).
            float expected = empty ? FARTHEST : push.expected;
            uint said = verdict(leaders[p], 1.0, push.fewest[int(empty)], pairs[p], neighbours[p], squares[p], sum[p], closed, expected);
            bool judged = inside && (!FINEST || (empty ? push.empties == 1u : (points & bit) != 0u));
            bool decides = judged && (said == OPEN || said == CLOSED);
            bits |= judged && (FINEST ? said == CLOSED : sum[p] < closed) ? bit : 0u;
            leading |= judged && !empty && said != TOO_FEW ? bit : 0u;
            left |= judged && !empty && !decides ? bit : 0u;
            settled |= decides && empty ? bit : 0u;
        }
        if (half_tile == 1) break;
    }
    uint word = 2u * tile + column / 4u;
    uint shift = 8u * (column % 4u);
    if (bits != 0u) atomicOr(invisible.word[word], bits << shift);
    if (bits != 0u && atomicExchange(kernels.tile[tile], 2u * RADIUS + 1u) == 0u) APPEND(holes, 0u, tile)
    if (FINEST) {
        if (leading != 0u) atomicOr(led.word[word], leading << shift);
        if (settled != 0u) atomicOr(decided.word[word], settled << shift);
        uint place = 0u;
        if (WORD(asked_words, asked, 3u * tile + 2u) < 2u) left = 0u;
        if (left != 0u) LEAVE(counts, 1, uint(bitCount(left)), place)
        for (; left != 0u; left &= left - 1u) {
            to.pixel[place] = uint(top.x) | uint(top.y + findLSB(left)) << 16;
            place += 1u;
        }
    }
}

void main() {
    EACH_OF(WORD(listed_words, lists, push.at + 3u), work)
}
