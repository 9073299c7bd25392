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
// Sectors are octants by integer offsets: ring r has r offsets in each, and an octant is the one before the last turned by a quarter. Points beyond the picture's edge are not known; the pixels inside
// stand for them as in a mirror, so that a hole at the edge is like any other.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require

#include "tile.glsl"

layout(local_size_x = 64) in;

layout(r32f) readonly uniform image2D depth;
layout(scalar) buffer Lists { uint word[]; } lists;
// Of every column of every tile, from the top, a bit a pixel; valid for tiles on the list of holes.
layout(scalar) writeonly buffer Invisible { uint column[]; } invisible;
// Of every tile, 1 when it is on that list.
layout(scalar) buffer Listed { uint tile[]; } listed;

layout(constant_id = 0) const uint SECTORS = 8u;
layout(constant_id = 1) const bool PERSPECTIVE = true;

layout(push_constant, scalar) uniform Push {
    uvec2 size;        // pixels
    uint tiles_across;
    uint at;           // the list of this kernel
    uint holes_at;     // the list of tiles with invisible pixels
    int radius;        // less than the picture's sides
    float px_per_unit;
    float threshold;   // steradians * SECTORS / 2 pi
} push;

const float FARTHEST = 3.402823466e38;
const float NOTHING = -FARTHEST;
const float FAR = 1099511627776.0;

// The pixel that is looked from.
struct Centre {
    ivec2 pixel;
    float z;     // in units of 1 / unit, a power of two near it, so that squares neither overflow nor vanish
    float unit;
    float f_rr;
    vec2 ray;
};

// 1 / 2^e of a positive f32 with exponent e.
float unit_of(float z) {
    return uintBitsToFloat(min(0x7F000000u - (floatBitsToUint(z) & 0x7F800000u), 0x7E800000u));
}

// t |t| of the neighbour at an offset, NOTHING where no point is. One a trillion times nearer or farther counts as one.
float lean(Centre c, ivec2 offset, bool at_edge) {
    ivec2 size = ivec2(push.size);
    ivec2 at = c.pixel + offset;
    if (at_edge) at = size - 1 - abs(size - 1 - abs(at));
    float zi = imageLoad(depth, at).r;
    float z = PERSPECTIVE ? clamp(zi * c.unit, 1.0 / FAR, FAR) : zi;
    vec2 d = vec2(offset);
    precise float aside = d.x * c.ray.x + d.y * c.ray.y;
    precise float twist = d.x * c.ray.y - d.y * c.ray.x;
    precise float along = (c.z - z) * c.f_rr - (PERSPECTIVE ? z * aside : 0.0);
    precise float across = PERSPECTIVE ? z * z * (d.x * d.x + d.y * d.y + twist * twist) : d.x * d.x + d.y * d.y;
    precise float t = along * abs(along) / across;
    return zi <= FARTHEST ? t : NOTHING;
}

float share(float lean, bool empty) {
    float square = min(abs(lean), FAR);
    precise float t = sqrt(square);
    precise float r = sqrt(1.0 + square);
    precise float closed = 1.0 / (r * (r + t));
    precise float open = 1.0 + t / r;
    return lean == NOTHING ? 1.0 : empty ? 0.0 : lean > 0.0 ? closed : open;
}

// The largest of each sector so far: octants, in `second` those beyond 22.5 degrees of them where there are sixteen sectors.
#define RING(rings, at_edge) \
    for (int r = 1; r <= (rings); ++r) { \
        for (int j = 0; j < r; ++j) { \
            ivec2 a = ivec2(r, j); \
            ivec2 b = ivec2(r - j, r); \
            vec4 even = vec4(lean(c, a, at_edge), lean(c, ivec2(-a.y, a.x), at_edge), lean(c, -a, at_edge), lean(c, ivec2(a.y, -a.x), at_edge)); \
            vec4 odd = vec4(lean(c, b, at_edge), lean(c, ivec2(-b.y, b.x), at_edge), lean(c, -b, at_edge), lean(c, ivec2(b.y, -b.x), at_edge)); \
            bool even_second = SECTORS == 16u && (j + r) * (j + r) >= 2 * r * r; \
            bool odd_second = SECTORS == 16u && (2 * r - j) * (2 * r - j) <= 2 * r * r; \
            even_first = even_second ? even_first : max(even_first, even); \
            odd_first = odd_second ? odd_first : max(odd_first, odd); \
            if (SECTORS == 16u) { \
                second_even = even_second ? max(second_even, even) : second_even; \
                second_odd = odd_second ? max(second_odd, odd) : second_odd; \
            } \
        } \
    }

float sum_of(vec4 leans, bool empty) {
    precise float sum = share(leans.x, empty) + share(leans.y, empty) + share(leans.z, empty) + share(leans.w, empty);
    return sum;
}

void main() {
    ivec2 size = ivec2(push.size);
    EACH_OF(lists.word[push.at + 3u]) {
        uint tile = lists.word[push.at + LIST_HEADER + n];
        ivec2 top = column_of(tile, push.tiles_across);
        ivec2 corner = tile_corner(tile, push.tiles_across);
        bool at_edge = any(lessThan(corner, ivec2(push.radius))) || any(greaterThan(corner + TILE_PX + push.radius, size));
        uint bits = 0u;
        for (int row = 0; row < TILE_PX; ++row) {
            Centre c;
            c.pixel = min(top + ivec2(0, row), size - 1);
            float z = imageLoad(depth, c.pixel).r;
            bool empty = !(z <= FARTHEST);
            c.unit = PERSPECTIVE ? unit_of(empty ? 1.0 : z) : 1.0;
            c.z = empty ? 1.0 : z * c.unit;
            c.ray = (vec2(c.pixel) + 0.5 - 0.5 * vec2(size)) / push.px_per_unit;
            precise float rr = 1.0 + c.ray.x * c.ray.x + c.ray.y * c.ray.y;
            c.f_rr = PERSPECTIVE ? push.px_per_unit * rr : push.px_per_unit;
            vec4 even_first = vec4(NOTHING);
            vec4 odd_first = vec4(NOTHING);
            vec4 second_even = vec4(NOTHING);
            vec4 second_odd = vec4(NOTHING);
            RING(at_edge ? 0 : push.radius, false)
            RING(at_edge ? push.radius : 0, true)
            precise float sum = 0.0;
            if (SECTORS == 4u) sum = sum_of(max(even_first, odd_first), empty);
            if (SECTORS >= 8u) sum = sum_of(even_first, empty) + sum_of(odd_first, empty);
            if (SECTORS == 16u) sum += sum_of(second_even, empty) + sum_of(second_odd, empty);
            bool inside = top.x < size.x && top.y + row < size.y;
            bits |= inside && sum < push.threshold ? 1u << row : 0u;
        }
        invisible.column[tile * 8u + gl_LocalInvocationID.x % 8u] = bits;
        if (bits != 0u && atomicExchange(listed.tile[tile], 1u) == 0u) APPEND(push.holes_at, tile)
    }
}
