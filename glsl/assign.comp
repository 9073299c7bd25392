// Tiles -> lists of tiles by kernel: where a hidden layer or a hole can be, and how far a pixel has to look to tell.
//
// A tile is left out where it and its neighbours are all empty, or all continuous. Elsewhere the kernel follows the spacing of the points where the tile is nearest: it is what others hide behind,
// and gaps between its points are the holes. A tile without points goes by its neighbours.
//
// That spacing is the node's, or, where the nearest surface is sparser there than its node, its own, counted over the tile and its neighbours. Its pixels are those of quarters of tiles that hold points
// of it, as the four beside them do: at a silhouette what lies beyond would be taken for gaps, and kernels would go over it. Where no quarter is such, gaps are as wide as quarters: there whole tiles are counted, this one and the
// four beside it, if all five hold points of it. A sparse part beside a dense one has few such quarters, and dense ones speak for it: what any of the five alone is found to be (gaps.comp) counts as well, and the sparsest is
// taken. Tiles in which the surface is not nearest keep the node's, but where two by two of them lie within it: there they lie in a gap.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "tile.glsl"

layout(local_size_x = 64) in;

layout(scalar) readonly buffer Tiles { Tile tile[]; } tiles;
layout(scalar) readonly buffer Gaps { float tile[]; } gaps;
layout(scalar) readonly buffer WideGaps { float block[]; } wide_gaps; // of two by two tiles
layout(scalar) buffer Lists { uint word[]; } lists;

layout(push_constant, scalar) uniform Push {
    uvec2 tiles;
    float px_per_unit; // perspective: focal length in pixels; orthographic: pixels per metre
    uint stride;     // words from list to list
    float widths[9]; // of the lists' kernels, pixels
    uint fine;       // lists whose kernels look at every pixel; the others look at every second
    uint least_list; // of those that the spacings of all points ask for
    uint most_list;
    float pixels_per_spacing; // width of the kernel
    float front_px; // as in classify.comp
    float sparser;  // counted spacings are multiplied by this, and are no more than
    float sparsest; // so many times the node's
    uint all; // 1: no tile is left out
    uint packed_at; // dispatches of pack_depth, for the narrow kernels and for the wide ones
    uvec2 pack_groups;
} push;

layout(constant_id = 0) const bool PERSPECTIVE = true;

const float FARTHEST = 3.402823466e38;

void main() {
    uint number = gl_GlobalInvocationID.x;
    if (number >= push.tiles.x * push.tiles.y) return;
    ivec2 across = ivec2(push.tiles);
    ivec2 own = in_rows(number, uint(push.tiles.x));
    uint points = 0u;
    float spacing = 0.0;
    float nearest = FARTHEST;
    bool continuous = true;
    [[dont_unroll]] for (int dy = -1; dy <= 1; ++dy) {
        [[dont_unroll]] for (int dx = -1; dx <= 1; ++dx) {
            ivec2 at = clamp(own + ivec2(dx, dy), ivec2(0), across - 1);
            Tile tile = tiles.tile[at.y * across.x + at.x];
            points += tile.points;
            spacing = max(spacing, tile.spacing);
            nearest = tile.points > 0u ? min(nearest, tile.nearest) : nearest;
            continuous = continuous && tile.continuous == 1u;
        }
    }
    if (push.all == 0u && (points == 0u || continuous)) return;
    // The quarters of the nine tiles, six across and six down: how many pixels each holds of the surface that is nearest, and of every row which hold any.
    uint held[9];
    // Of this tile and those beside it, as far as they are of that surface: the widest.
    float gap = 0.0;
    uint rows[6] = uint[6](0u, 0u, 0u, 0u, 0u, 0u);
    [[unroll]] for (int t = 0; t < 9; ++t) {
        ivec2 at = clamp(own + ivec2(t % 3 - 1, t / 3 - 1), ivec2(0), across - 1);
        Tile tile = tiles.tile[at.y * across.x + at.x];
        bool of_front = tile.points > 0u && in_front(tile.nearest, nearest, push.front_px, push.px_per_unit, PERSPECTIVE);
        held[t] = of_front ? tile.front : 0u;
        if (t == 4 || t % 2 == 1) gap = max(gap, of_front ? gaps.tile[at.y * across.x + at.x] : 0.0);
        [[unroll]] for (int q = 0; q < 4; ++q) rows[2 * (t / 3) + q / 2] |= uint((held[t] >> (8 * q) & 255u) > 0u) << (2 * (t % 3) + q % 2);
    }
    uint inner[6] = uint[6](0u, 0u, 0u, 0u, 0u, 0u);
    [[unroll]] for (int row = 1; row < 5; ++row) inner[row] = rows[row - 1] & rows[row] & rows[row + 1] & rows[row] << 1 & rows[row] >> 1;
    uint front = 0u;
    uint extent = 0u;
    [[unroll]] for (int k = 0; k < 36; ++k) {
        uint counts = inner[2 * (k / 12) + k % 4 / 2] >> (2 * (k / 4 % 3) + k % 2) & 1u;
        front += counts * (held[k / 4] >> (8 * (k % 4)) & 255u);
        extent += counts * uint(TILE_PX / 2 * TILE_PX / 2);
    }
    uint beside = 0u;
    bool crossed = true;
    [[unroll]] for (int t = 0; t < 9; ++t) {
        bool counts = t == 4 || t % 2 == 1;
        beside += counts ? in_quarters(held[t]) : 0u;
        crossed = crossed && (held[t] > 0u || !counts);
    }
    if (extent > 0u) gap = max(gap, apart(float(front) / float(extent)));
    else if (crossed) gap = max(gap, apart(float(beside) / float(5 * TILE_PX * TILE_PX)));
    Tile at = tiles.tile[number];
    bool is_front = at.points > 0u && in_front(at.nearest, nearest, push.front_px, push.px_per_unit, PERSPECTIVE);
    ivec2 block = own / 2;
    float wide = wide_gaps.block[block.y * ((across.x + 1) / 2) + block.x];
    float counted = push.sparser * max(is_front ? gap : 0.0, wide);
    float of_node = at.points > 0u ? at.spacing : spacing;
    float kernel = clamp(counted, of_node, push.sparsest * of_node) * push.pixels_per_spacing;
    uint list = 0u;
    [[unroll]] for (int k = 0; k < 8; ++k) list += kernel > push.widths[k] ? 1u : 0u;
    list = clamp(list, push.least_list, push.most_list);
    uint packed_for = push.packed_at + (list < push.fine ? 0u : LIST_HEADER);
    if (lists.word[packed_for] == 0u) {
        lists.word[packed_for + 1u] = push.pack_groups.y;
        lists.word[packed_for + 2u] = 1u;
        lists.word[packed_for] = push.pack_groups.x;
    }
    APPEND(list * push.stride, number)
}
