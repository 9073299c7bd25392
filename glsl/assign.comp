// Tiles -> lists of tiles by kernel: where a hidden layer or a hole can be, and how far a pixel has to look to tell.
//
// A tile is left out where it and its neighbours are all empty, or all continuous. Elsewhere the kernel follows the spacing of the points where the tile is nearest: it is what others hide behind,
// and gaps between its points are the holes. A tile without points goes by its neighbours.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "tile.glsl"

layout(local_size_x = 64) in;

layout(scalar) readonly buffer Tiles { Tile tile[]; } tiles;
layout(scalar) buffer Lists { uint word[]; } lists;

layout(push_constant, scalar) uniform Push {
    uvec2 tiles;
    uint stride;     // words from list to list
    float widths[9]; // of the lists' kernels, pixels
    uint fine;       // lists whose kernels look at every pixel; the others look at every second
    uint least_list; // of those that the spacings of all points ask for
    uint most_list;
    float pixels_per_spacing; // width of the kernel
    uint all; // 1: no tile is left out
    uint packed_at; // dispatches of pack_depth, for the narrow kernels and for the wide ones
    uvec2 pack_groups;
} push;

void main() {
    uint number = gl_GlobalInvocationID.x;
    if (number >= push.tiles.x * push.tiles.y) return;
    ivec2 across = ivec2(push.tiles);
    ivec2 own = in_rows(number, uint(push.tiles.x));
    uint points = 0u;
    float spacing = 0.0;
    bool continuous = true;
    [[dont_unroll]] for (int dy = -1; dy <= 1; ++dy) {
        [[dont_unroll]] for (int dx = -1; dx <= 1; ++dx) {
            ivec2 at = clamp(own + ivec2(dx, dy), ivec2(0), across - 1);
            Tile tile = tiles.tile[at.y * across.x + at.x];
            points += tile.points;
            spacing = max(spacing, tile.spacing);
            continuous = continuous && tile.continuous == 1u;
        }
    }
    if (push.all == 0u && (points == 0u || continuous)) return;
    Tile at = tiles.tile[number];
    float kernel = (at.points > 0u ? at.spacing : spacing) * push.pixels_per_spacing;
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
