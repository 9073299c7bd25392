// Points scattered in depth -> how little the surroundings of each tile are a surface: branches,
// leaves, strays.
// There points have others in front on all sides, and yet no level can call them hidden
// (visibility_levels.comp). On surfaces that happens only at some contours.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "tile.glsl"

layout(local_size_x = 64) in;

layout(scalar) readonly buffer Tiles { Tile tile[]; } tiles;
// Two words per tile, one bit per pixel.
layout(scalar) readonly buffer Invisible { uint word[]; } invisible;
layout(scalar) readonly buffer Scattered { uint word[]; } scattered;
// Share from which the surroundings of a tile are no surface.
layout(scalar) writeonly buffer Rough { float tile[]; } rough;

layout(push_constant, scalar) uniform Push {
    uvec2 tiles;
    uint part; // one in `part` of the points around
} push;

// Tiles to either side.
const int AROUND = 3;

void main() {
    uint number = gl_GlobalInvocationID.x;
    if (number >= push.tiles.x * push.tiles.y) return;
    ivec2 own = in_rows(number, push.tiles.x);
    int points = 0;
    int scattered_points = 0;
    [[dont_unroll]] for (int dy = -AROUND; dy <= AROUND; ++dy) {
        [[dont_unroll]] for (int dx = -AROUND; dx <= AROUND; ++dx) {
            ivec2 at = clamp(own + ivec2(dx, dy), ivec2(0), ivec2(push.tiles) - 1);
            int beside = at.y * int(push.tiles.x) + at.x;
            uvec2 seen = uvec2(tiles.tile[beside].points_left, tiles.tile[beside].points_right) & ~uvec2(invisible.word[2 * beside], invisible.word[2 * beside + 1]);
            uvec2 odd = seen & uvec2(scattered.word[2 * beside], scattered.word[2 * beside + 1]);
            points += bitCount(seen.x) + bitCount(seen.y);
            scattered_points += bitCount(odd.x) + bitCount(odd.y);
        }
    }
    rough.tile[number] = float(scattered_points * int(push.part)) / float(max(points, 1));
}
