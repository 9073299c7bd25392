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
// hemispheres. A point at the camera's own side of a plane through p0 opens its cone beyond the hemisphere (t < 0).
//
// Sectors are octants by integer offsets: ring r has r offsets in each, and the other seven octants are that one turned, so that loops unroll without a table.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require

#include "tile.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

layout(r32f) readonly uniform image2D depth;
layout(scalar) buffer Lists { uint word[]; } lists;
// Of each tile a bit a pixel, and whether there is one.
layout(scalar) buffer Invisible { uint word[]; } invisible;

layout(constant_id = 0) const uint RADIUS = 4u;
layout(constant_id = 1) const uint SECTORS = 8u;
layout(constant_id = 2) const bool PERSPECTIVE = true;

layout(push_constant, scalar) uniform Push {
    uvec2 size;        // pixels
    uint tiles_across;
    uint at;           // the list of this kernel
    uint holes_at;     // the list of tiles with invisible pixels
    float px_per_unit;
    float threshold;   // steradians * SECTORS / 2 pi
} push;

const float FARTHEST = 3.402823466e38;
const float NOTHING = -FARTHEST;
const float FAR = 1099511627776.0;

// 1 / 2^e of a positive f32 with exponent e.
float unit_of(float z) {
    return uintBitsToFloat(min(0x7F000000u - (floatBitsToUint(z) & 0x7F800000u), 0x7E800000u));
}

// z0 in units of `unit`, a power of two near it, so that squares neither overflow nor vanish; a neighbour a trillion times nearer or farther counts as one.
float t_squared(float z0, float unit, float zi, float f_rr, vec2 r0, vec2 d) {
    bool point = zi <= FARTHEST;
    float z = PERSPECTIVE ? clamp(zi * unit, 1.0 / FAR, FAR) : zi;
    precise float aside = d.x * r0.x + d.y * r0.y;
    precise float twist = d.x * r0.y - d.y * r0.x;
    precise float along = (z0 - z) * f_rr - (PERSPECTIVE ? z * aside : 0.0);
    precise float across = PERSPECTIVE ? z : 1.0;
    precise float square = across * across * (d.x * d.x + d.y * d.y + (PERSPECTIVE ? twist * twist : 0.0));
    precise float t = along * abs(along) / square;
    return point ? t : NOTHING;
}

float share(float t_squared, bool empty) {
    float square = min(abs(t_squared), FAR);
    precise float t = sqrt(square);
    precise float r = sqrt(1.0 + square);
    precise float closed = 1.0 / (r * (r + t));
    precise float open = 1.0 + t / r;
    return t_squared == NOTHING ? 1.0 : empty ? 0.0 : t_squared > 0.0 ? closed : open;
}

void main() {
    ivec2 size = ivec2(push.size);
    uint count = lists.word[push.at + 3u];
    for (uint n = gl_WorkGroupID.x; n < count; n += gl_NumWorkGroups.x) {
        uint tile = lists.word[push.at + LIST_HEADER + n];
        ivec2 pixel = tile_corner(tile, push.tiles_across) + ivec2(gl_LocalInvocationID.xy);
        float z = imageLoad(depth, mirrored(pixel, size)).r;
        bool empty = !(z <= FARTHEST);
        float unit = PERSPECTIVE ? unit_of(empty ? 1.0 : z) : 1.0;
        float z0 = empty ? 1.0 : z * unit;
        vec2 r0 = (vec2(pixel) + 0.5 - 0.5 * vec2(size)) / push.px_per_unit;
        precise float rr = 1.0 + r0.x * r0.x + r0.y * r0.y;
        precise float f_rr = PERSPECTIVE ? push.px_per_unit * rr : push.px_per_unit;

        // Octants, each in two halves: below and above 22.5 degrees from its first side.
        float most[16];
        for (int s = 0; s < 16; ++s) most[s] = NOTHING;
        for (int r = 1; r <= int(RADIUS); ++r) {
            for (int j = 0; j < r; ++j) {
                // The octant's first side is an axis for even octants, a diagonal for odd ones.
                ivec2 from_axis = ivec2(r, j);
                ivec2 from_diagonal = ivec2(r - j, r);
                int axis_half = SECTORS == 16u && (j + r) * (j + r) >= 2 * r * r ? 1 : 0;
                int diagonal_half = SECTORS == 16u && (2 * r - j) * (2 * r - j) <= 2 * r * r ? 1 : 0;
                for (int turn = 0; turn < 4; ++turn) {
                    float a = t_squared(z0, unit, imageLoad(depth, mirrored(pixel + from_axis, size)).r, f_rr, r0, vec2(from_axis));
                    float b = t_squared(z0, unit, imageLoad(depth, mirrored(pixel + from_diagonal, size)).r, f_rr, r0, vec2(from_diagonal));
                    int sector = 4 * turn;
                    most[sector + axis_half] = max(most[sector + axis_half], a);
                    most[sector + 2 + diagonal_half] = max(most[sector + 2 + diagonal_half], b);
                    from_axis = ivec2(-from_axis.y, from_axis.x);
                    from_diagonal = ivec2(-from_diagonal.y, from_diagonal.x);
                }
            }
        }
        precise float sum = 0.0;
        for (int s = 0; s < 16; s += SECTORS == 16u ? 1 : SECTORS == 8u ? 2 : 4) {
            sum += share(SECTORS == 4u ? max(most[s], most[s + 2]) : most[s], empty);
        }
        if (sum < push.threshold && pixel.x < size.x && pixel.y < size.y) {
            uint bit = gl_LocalInvocationIndex;
            atomicOr(invisible.word[WORDS_PER_TILE * tile + bit / 32u], 1u << (bit & 31u));
            if (atomicExchange(invisible.word[WORDS_PER_TILE * tile + 2u], 1u) == 0u) APPEND(push.holes_at, tile)
        }
    }
}
