// Which pixels show a surface or the background, and which a hidden layer or a hole (Pintus et al. 2011, sec. 4; papers/README.md).
//
// Around the ray from the pixel's point p0 to the camera, every sector of the neighbourhood leaves an empty cone: its half-angle is that to the neighbour nearest to the
// ray. The pixel is visible where the cones' solid angles add up to `threshold`.
//
//   p0 - camera = z0 r0,  pi - camera = zi ri,  ri = r0 + (dx, dy, 0) / f
//   cotangent of the angle at p0 between the ray to the camera and that to pi:
//     t = ((z0 - zi) f r0.r0 - zi (d . r0)) / (zi sqrt(d.d + (d x r0)^2))        nothing cancels but z0 - zi, which is exact
//   the sector's share of its hemisphere: 1 - cos = 1 - t / sqrt(1 + t t)         1 for a sector without a neighbour
// Since only the largest t of a sector counts, t |t| is compared, and roots are taken once a sector. A pixel without a point stands for one beyond all its neighbours: its cones are closed, or
// hemispheres. A neighbour beyond the plane through p0 across the ray opens its cone beyond the hemisphere (t < 0).
//
// Sectors are octants by integer offsets, halved at 22.5 degrees where there are sixteen, joined in pairs where there are four. A lane takes four pixels of a column: their neighbourhoods overlap, and a
// texel of `packed_depth` holds four rows.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "tile.glsl"

layout(local_size_x = 64) in;

layout(r32f) readonly uniform image2D depth;
layout(rgba32f) readonly uniform image2D packed_depth;
layout(scalar) buffer Lists { uint word[]; } lists;
layout(r32ui) readonly uniform uimageBuffer listed_words;
// Of every column of every tile, from the top, a bit a pixel; valid for tiles on the list of holes.
layout(scalar) writeonly buffer Invisible { uint column[]; } invisible;
// Of every tile, 1 when it is on that list.
layout(scalar) buffer Listed { uint tile[]; } listed;

layout(constant_id = 0) const uint RADIUS = 4u;
layout(constant_id = 1) const uint SECTORS = 8u;
layout(constant_id = 2) const bool PERSPECTIVE = true;
// Pixels from neighbour to neighbour: 2 where `packed_depth` holds the nearest of 2 x 2.
layout(constant_id = 3) const uint STRIDE = 1u;
layout(constant_id = 4) const bool TEXELS = true;

layout(push_constant, scalar) uniform Push {
    uvec2 size;        // pixels
    uint tiles_across;
    uint at;           // the list of this kernel
    uint holes_at;     // the list of tiles with invisible pixels
    float px_per_unit;
    float threshold;   // steradians * SECTORS / 2 pi
    float holes;       // the same for a pixel without a point
} push;

const float FARTHEST = 3.402823466e38;
// Depths beyond these count as these, so that squares neither overflow nor vanish.
const float NEAREST_PLACE = 1e-15;
const float FARTHEST_PLACE = 1e15;
// t |t| where no point is: less than any other.
const float NOTHING = -1e37;

const int R = int(RADIUS);
const int STEP = int(STRIDE);
// Texels above and below a lane's own.
const int REACH = (R * STEP + 3) / 4;
const int ROWS = 4 * (2 * REACH + 1);

float share(float lean, bool empty) {
    float square = min(abs(lean), 1e30);
    precise float t = sqrt(square);
    precise float r = sqrt(1.0 + square);
    precise float closed = 1.0 / (r * (r + t));
    precise float open = 1.0 + t / r;
    return lean <= NOTHING ? 1.0 : empty ? 0.0 : lean > 0.0 ? closed : open;
}

// The sector of an offset: two to an octant, of which the second is used only where there are sixteen.
int sector_of(ivec2 d) {
    ivec2 a = abs(d);
    int octant = d.x > 0 ? (d.y >= 0 ? (d.y < d.x ? 0 : 1) : (a.y <= a.x ? 7 : 6))
               : d.x < 0 ? (d.y > 0 ? (a.y <= a.x ? 3 : 2) : (a.y < a.x ? 4 : 5))
               : d.y > 0 ? 2 : 6;
    int longer = max(a.x, a.y);
    bool beyond = (a.x + a.y) * (a.x + a.y) >= 2 * longer * longer;
    bool second = SECTORS == 16u && (octant % 2 == 0 ? beyond : !beyond);
    return 2 * octant + (second ? 1 : 0);
}

// The depths of a column of neighbours, of all four pixels.
#define LOAD_COLUMN(dx) \
    [[unroll]] for (int q = 0; q < 2 * REACH + 1; ++q) { \
        vec4 four = imageLoad(packed_depth, texel + ivec2(STEP * (dx), q - REACH)); \
        [[unroll]] for (int c = 0; c < 4; ++c) { \
            bool point = four[c] <= FARTHEST; \
            float place = clamp(four[c], NEAREST_PLACE, FARTHEST_PLACE); \
            z[4 * q + c] = place; \
            zz[4 * q + c] = point ? (PERSPECTIVE ? place * place : 1.0) : 0.0; \
        } \
    }

// t |t| of the neighbour at (dx, dy) of pixel p.
#define LEAN(t, p, dx, dy) \
    int i = 4 * REACH + p + STEP * dy; \
    precise float aside = float(STEP * dx) * ray_x + float(STEP * dy) * ray_y[p]; \
    precise float twist = float(STEP * dx) * ray_y[p] - float(STEP * dy) * ray_x; \
    precise float along = (z0[p] - z[i]) * f_rr[p] - (PERSPECTIVE ? z[i] * aside : 0.0); \
    precise float across = zz[i] * (float(STEP * STEP * (dx * dx + dy * dy)) + (PERSPECTIVE ? twist * twist : 0.0)); \
    precise float ratio = along * abs(along) / across; \
    float t = zz[i] > 0.0 ? ratio : NOTHING;

// Columns on one side of the pixel. The loop over them stays a loop, so that wide kernels compile fast: a row then has two octants, one for columns nearer than the row is, and one for those farther.
#define SIDE(side) \
    for (int m = 1; m <= R; ++m) { \
        int dx = side * m; \
        LOAD_COLUMN(dx) \
        [[unroll]] for (int p = 0; p < 4; ++p) { \
            [[unroll]] for (int dy = -R; dy <= R; ++dy) { \
                LEAN(t, p, dx, dy) \
                int across_row = 16 * p + sector_of(ivec2(side * (abs(dy) + 1), dy)); \
                int along_row = 16 * p + (dy == 0 ? sector_of(ivec2(side, 0)) : sector_of(ivec2(side, 3 * dy))); \
                bool diagonal = 16 * p + sector_of(ivec2(side * max(abs(dy), 1), dy)) == across_row; \
                bool wide = m > abs(dy) || (m == abs(dy) && diagonal); \
                most[across_row] = max(most[across_row], wide ? t : NOTHING); \
                most[along_row] = max(most[along_row], wide ? NOTHING : t); \
            } \
        } \
    }

const int MOST_ROWS = 36;

void main() {
    ivec2 size = ivec2(push.size);
    EACH_OF(WORD(listed_words, lists, push.at + 3u)) {
        uint tile = WORD(listed_words, lists, push.at + LIST_HEADER + n);
        ivec2 top = column_of(tile, push.tiles_across);
        uint bits = 0u;
        for (int half_tile = 0; half_tile < 2; ++half_tile) {
            int first = top.y + 4 * half_tile;
            ivec2 texel = ivec2(top.x + MARGIN_PX, (first + MARGIN_PX) / 4);
            float ray_x = (float(top.x) + 0.5 - 0.5 * float(size.x)) / push.px_per_unit;
            float ray_y[4];
            float z0[4];
            float f_rr[4];
            float most[64];
            vec4 own;
            [[unroll]] for (int p = 0; p < 4; ++p) {
                own[p] = imageLoad(depth, min(ivec2(top.x, first + p), size - 1)).r;
                ray_y[p] = (float(first + p) + 0.5 - 0.5 * float(size.y)) / push.px_per_unit;
                z0[p] = clamp(own[p], NEAREST_PLACE, FARTHEST_PLACE);
                precise float rr = 1.0 + ray_x * ray_x + ray_y[p] * ray_y[p];
                f_rr[p] = PERSPECTIVE ? push.px_per_unit * rr : push.px_per_unit;
                [[unroll]] for (int s = 0; s < 16; ++s) most[16 * p + s] = NOTHING;
            }
            float z[MOST_ROWS];
            float zz[MOST_ROWS];
            if (SECTORS == 16u) {
                [[unroll]] for (int dx = -R; dx <= R; ++dx) {
                    LOAD_COLUMN(dx)
                    [[unroll]] for (int p = 0; p < 4; ++p) {
                        [[unroll]] for (int dy = -R; dy <= R; ++dy) {
                            LEAN(t, p, dx, dy)
                            int s = 16 * p + sector_of(ivec2(dx, dy));
                            if (dx != 0 || dy != 0) most[s] = max(most[s], t);
                        }
                    }
                }
            } else {
                SIDE(-1)
                SIDE(1)
                LOAD_COLUMN(0)
                [[unroll]] for (int p = 0; p < 4; ++p) {
                    [[unroll]] for (int dy = -R; dy <= R; ++dy) {
                        LEAN(t, p, 0, dy)
                        int s = 16 * p + sector_of(ivec2(0, dy));
                        if (dy != 0) most[s] = max(most[s], t);
                    }
                }
            }
            [[unroll]] for (int p = 0; p < 4; ++p) {
                bool empty = !(own[p] <= FARTHEST);
                precise float sum = 0.0;
                if (SECTORS == 4u) {
                    [[unroll]] for (int s = 0; s < 4; ++s) sum += share(max(most[16 * p + 4 * s], most[16 * p + 4 * s + 2]), empty);
                } else if (SECTORS == 8u) {
                    [[unroll]] for (int s = 0; s < 8; ++s) sum += share(most[16 * p + 2 * s], empty);
                } else {
                    [[unroll]] for (int s = 0; s < 16; ++s) sum += share(most[16 * p + s], empty);
                }
                bool inside = top.x < size.x && first + p < size.y;
                bits |= inside && sum < (empty ? push.holes : push.threshold) ? 1u << (4 * half_tile + p) : 0u;
            }
        }
        invisible.column[tile * 8u + gl_LocalInvocationID.x % 8u] = bits;
        if (bits != 0u && atomicExchange(listed.tile[tile], 1u) == 0u) APPEND(push.holes_at, tile)
    }
}
