// Depth -> tiles: what each tile of 8 x 8 pixels holds.
//
// A tile is continuous where every pixel holds a point and no pixel is farther from its right and lower neighbours than `slope` pixels' width.
// Then no neighbour within any kernel hides a point: n steps away depths differ by n times that at most (passes/visibility.rs has the bound).
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require

#include "tile.glsl"

layout(local_size_x = 64) in;

layout(r32f) readonly uniform image2D depth;
layout(scalar) writeonly buffer Tiles { Tile tile[]; } tiles;

layout(constant_id = 0) const bool PERSPECTIVE = true;

layout(push_constant, scalar) uniform Push {
    uvec2 size;        // pixels
    uvec2 tiles;
    float px_per_unit; // perspective: focal length in pixels; orthographic: pixels per metre
    float slope;
} push;

void main() {
    uint number = gl_GlobalInvocationID.x;
    if (number >= push.tiles.x * push.tiles.y) return;
    ivec2 size = ivec2(push.size);
    ivec2 corner = tile_corner(number, push.tiles.x);
    uint points = 0u;
    bool continuous = true;
    const float FARTHEST = 3.402823466e38;
    float nearest = FARTHEST;
    float farthest = 0.0;
    float above[TILE_PX + 1];
    for (int x = 0; x <= TILE_PX; ++x) {
        above[x] = imageLoad(depth, mirrored(corner + ivec2(x, 0), size)).r;
    }
    for (int y = 0; y < TILE_PX; ++y) {
        float below[TILE_PX + 1];
        for (int x = 0; x <= TILE_PX; ++x) {
            below[x] = imageLoad(depth, mirrored(corner + ivec2(x, y + 1), size)).r;
        }
        for (int x = 0; x < TILE_PX; ++x) {
            float z = above[x];
            bool inside = corner.x + x < size.x && corner.y + y < size.y;
            bool point = inside && z <= FARTHEST;
            points += point ? 1u : 0u;
            nearest = min(nearest, point ? z : FARTHEST);
            farthest = max(farthest, point ? z : 0.0);
            float least = min(z, min(above[x + 1], below[x]));
            float most = max(z, max(above[x + 1], below[x]));
            precise float rise = (min(most, FARTHEST) - min(least, FARTHEST)) * push.px_per_unit;
            precise float run = (PERSPECTIVE ? least : 1.0) * push.slope;
            continuous = continuous && (!inside || (most <= FARTHEST && rise <= run));
        }
        above = below;
    }
    tiles.tile[number] = Tile(points, continuous ? 1u : 0u, nearest, farthest);
}
