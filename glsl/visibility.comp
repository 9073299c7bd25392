// Which pixels show a surface or the background, and which a hidden layer or a hole (Pintus et al. 2011, sec. 4; papers/README.md).
//
// Around the ray from the pixel's point p0 to the camera, every sector of the neighbourhood leaves an empty cone: its half-angle is that to the neighbour nearest to the
// ray. The pixel is visible where the cones' solid angles add up to `threshold`.
//
//   p0 - camera = z0 r0,  pi - camera = zi ri,  ri = r0 + (dx, dy, 0) / f
//   cotangent of the angle at p0 between the ray to the camera and that to pi:
//     t = ((z0 - zi) f r0.r0 - zi (d . r0)) / (zi sqrt(d.d + (d x r0)^2))        nothing cancels but z0 - zi, which is exact
//   the sector's share of its hemisphere: 1 - cos = 1 - t / sqrt(1 + t t)         1 for a sector without a neighbour, or where that may be of the pixel's own surface: 0 < t <= `own_slope`
// Since only the largest t of a sector counts, t |t| is compared, and roots are taken once a sector. A pixel without a point stands for one beyond all its neighbours: its cones are closed, or
// hemispheres. A neighbour beyond the plane through p0 across the ray opens its cone beyond the hemisphere (t < 0).
//
// Sectors are told by integer offsets. Half of them lie to the right of the pixel, or straight above it; the others are the same after half a turn, and so is the code. A lane takes four pixels of a
// column: their neighbourhoods overlap, and a texel of `packed_depth` holds four rows. The loop over columns stays a loop, so that wide kernels compile fast.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "tile.glsl"

layout(local_size_x = 64) in;

layout(r32f) readonly uniform image2D depth;
layout(rgba32f) readonly uniform image2D packed_depth;
layout(scalar) readonly buffer Lists { uint word[]; } lists;
// Tiles with invisible pixels.
layout(scalar) buffer Holes { uint word[]; } holes;
layout(r32ui) readonly uniform uimageBuffer listed_words;
// Of every tile two words, a bit a pixel (lib/tile.glsl).
layout(scalar) buffer Invisible { uint word[]; } invisible;
// Of every tile on that list, the width of the kernel that put it there, pixels; 0 of others.
layout(scalar) buffer Kernels { uint tile[]; } kernels;

layout(constant_id = 0) const uint RADIUS = 4u;
layout(constant_id = 1) const uint SECTORS = 8u;
layout(constant_id = 2) const bool PERSPECTIVE = true;
layout(constant_id = 3) const bool TEXELS = true;

layout(push_constant, scalar) uniform Push {
    uvec2 size;        // pixels
    vec2 centre;       // where the camera looks, pixels from the first
    uint tiles_across;
    float px_per_unit;
    float threshold;   // steradians * SECTORS / 2 pi
    float hole;        // the same for a pixel without a point
    float own_slope;   // t t up to which a neighbour closes nothing
} push;

const float FARTHEST = 3.402823466e38;
// Depths beyond these count as these, so that squares neither overflow nor vanish.
const float NEAREST_PLACE = 1e-15;
const float FARTHEST_PLACE = 1e15;
// t |t| where no point is: less than any other.
const float NOTHING = -1e37;

const int R = int(RADIUS);
// Texels above and below a lane's own, and pixels from the first of them to the lane's first.
const int REACH = (R + 3) / 4;
const int ABOVE = 4 * REACH;
const int MOST_ROWS = 20;
const int PER_QUARTER = int(SECTORS) / 4;

// Of a sector: its solid angle in hemispheres' shares, from its largest t |t|.
float share(float lean, bool empty) {
    float square = min(abs(lean), 1e18);
    float hypotenuse = 1.0 + square;
    float closed = 1.0 / (hypotenuse + sqrt(hypotenuse * square));
    float open = 2.0 - closed;
    float known = empty ? 0.0 : lean > push.own_slope ? closed : lean > 0.0 ? 1.0 : open;
    return lean <= NOTHING ? 1.0 : known;
}

// The sector of an offset in its quarter of the plane, which begins with an axis: 0 to PER_QUARTER - 1.
int sector_of(int along, int beside) {
    bool eighth = beside >= along;
    int shorter = eighth ? beside - along : along + beside;
    bool sixteenth = shorter * shorter > 2 * along * along;
    return SECTORS == 4u ? 0 : SECTORS == 8u ? int(eighth) : 2 * int(eighth) + int(sixteenth);
}

void work(uint n) {
    ivec2 size = ivec2(push.size);
    float farthest = PERSPECTIVE ? FARTHEST_PLACE : FARTHEST_PLACE / push.px_per_unit;
    uint tile = WORD(listed_words, lists, LIST_HEADER + n);
    ivec2 top = column_of(tile, push.tiles_across);
    uint bits = 0u;
    [[dont_unroll]] for (int half_tile = 0;; ++half_tile) {
        int first = top.y + 4 * half_tile;
        ivec2 texel = ivec2(top.x + MARGIN_PX, (first + MARGIN_PX) / 4);
        float ray_x = (float(top.x) + 0.5 - push.centre.x) / push.px_per_unit;
        vec4 ray_y, z0, f_rr, own;
        vec4 sum = vec4(0.0);
        [[unroll]] for (int p = 0; p < 4; ++p) {
            own[p] = imageLoad(depth, min(ivec2(top.x, first + p), size - 1)).r;
            ray_y[p] = (float(first + p) + 0.5 - push.centre.y) / push.px_per_unit;
            float rr = 1.0 + ray_x * ray_x + ray_y[p] * ray_y[p];
            f_rr[p] = PERSPECTIVE ? push.px_per_unit * rr : push.px_per_unit;
            z0[p] = clamp(own[p], NEAREST_PLACE, farthest);
        }
        [[dont_unroll]] for (int side = 1;; side = -1) {
            float most[32];
            [[unroll]] for (int s = 0; s < 32; ++s) most[s] = NOTHING;
            [[dont_unroll]] for (int dx = 0;; ++dx) {
                // The depths of a column of neighbours, of all four pixels, and the squares by which lengths are multiplied, 0 where no point is.
                float z[MOST_ROWS];
                float zz[MOST_ROWS];
                [[unroll]] for (int q = 0; q < 2 * REACH + 1; ++q) {
                    vec4 four = imageLoad(packed_depth, texel + side * ivec2(dx, q - REACH));
                    four = mix(four.wzyx, four, bvec4(side > 0));
                    [[unroll]] for (int c = 0; c < 4; ++c) {
                        float place = clamp(four[c], NEAREST_PLACE, farthest);
                        z[4 * q + c] = place;
                        zz[4 * q + c] = mix(0.0, PERSPECTIVE ? place * place : 1.0, four[c] <= FARTHEST);
                    }
                }
                [[unroll]] for (int dy = -R; dy <= R; ++dy) {
                    // The half plane has the axis above the pixel, and not the one below it.
                    int sector = dy < 0 ? sector_of(-dy, dx) : dx > 0 ? sector_of(dx, dy) : PER_QUARTER;
                    [[unroll]] for (int p = 0; p < 4; ++p) {
                        int i = ABOVE + p + dy;
                        float aside = float(dx) * ray_x + float(dy) * ray_y[p];
                        float twist = float(dx) * ray_y[p] - float(dy) * ray_x;
                        float along = (z0[p] - z[i]) * f_rr[p] - (PERSPECTIVE ? z[i] * aside : 0.0);
                        float across = zz[i] * (float(dx * dx + dy * dy) + (PERSPECTIVE ? twist * twist : 0.0));
                        float ratio = along * abs(along) / across;
                        float lean = mix(NOTHING, ratio, zz[i] > 0.0);
                        [[unroll]] for (int k = 0; k < PER_QUARTER; ++k) {
                            int s = 8 * p + (dy < 0 ? 0 : 4) + k;
                            most[s] = max(most[s], mix(NOTHING, lean, sector == k));
                        }
                    }
                }
                if (dx == R) break;
            }
            [[unroll]] for (int p = 0; p < 4; ++p) {
                [[unroll]] for (int k = 0; k < PER_QUARTER; ++k) {
                    bool empty = !(own[p] <= FARTHEST);
                    float shares = share(most[8 * p + k], empty) + share(most[8 * p + 4 + k], empty);
                    sum[p] += shares;
                }
            }
            // Half a turn.
            ray_x = -ray_x;
            ray_y = -ray_y.wzyx;
            f_rr = f_rr.wzyx;
            z0 = z0.wzyx;
            own = own.wzyx;
            sum = sum.wzyx;
            if (side < 0) break;
        }
        [[unroll]] for (int p = 0; p < 4; ++p) {
            bool inside = top.x < size.x && first + p < size.y;
            bool empty = !(own[p] <= FARTHEST);
            bits |= inside && sum[p] < (empty ? push.hole : push.threshold) ? 1u << (4 * half_tile + p) : 0u;
        }
        if (half_tile == 1) break;
    }
    uint column = gl_LocalInvocationID.x % 8u;
    if (bits != 0u) atomicOr(invisible.word[2u * tile + column / 4u], bits << (8u * (column % 4u)));
    if (bits != 0u && atomicExchange(kernels.tile[tile], 2u * RADIUS + 1u) == 0u) APPEND(holes, 0u, tile)
}

void main() {
    EACH_OF(WORD(listed_words, lists, 3u), work)
}
