// Depth -> tiles: what each tile of 8 x 8 pixels holds, how many points its nearest surface has, and how far apart those of its node are on the screen.
//
// A tile is continuous where every pixel holds a point and no pixel is farther from its right and lower neighbours than `slope` pixels' width.
// Then no neighbour within any kernel hides a point: n steps away depths differ by n times that at most (passes/visibility.rs has the bound).
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require

#include "node.glsl"
#include "tile.glsl"

layout(local_size_x = 64) in;

layout(r32f) readonly uniform image2D depth;
layout(r32ui) readonly uniform uimage2D index;
// Of every node of the frame, how far apart its points are: bits of a float, metres.
layout(r32ui) readonly uniform uimageBuffer spacings;
layout(scalar) writeonly buffer Tiles { Tile tile[]; } tiles;

layout(constant_id = 0) const bool PERSPECTIVE = true;

layout(push_constant, scalar) uniform Push {
    uvec2 size;        // pixels
    uvec2 tiles;
    float px_per_unit; // perspective: focal length in pixels; orthographic: pixels per metre
    float slope;
    float front_px;    // how far behind each other points of one surface are in a tile, pixels' width
} push;

const float FARTHEST = 3.402823466e38;

// Whether two adjacent pixels hold points of one surface.
bool adjoin(float a, float b) {
    float least = min(a, b);
    float most = min(max(a, b), FARTHEST);
    float rise = (most - min(least, FARTHEST)) * push.px_per_unit;
    float run = (PERSPECTIVE ? least : 1.0) * push.slope;
    return max(a, b) <= FARTHEST && rise <= run;
}

void main() {
    uint number = gl_GlobalInvocationID.x;
    if (number >= push.tiles.x * push.tiles.y) return;
    ivec2 last = ivec2(push.size) - 1;
    ivec2 corner = tile_corner(number, push.tiles.x);
    ivec2 end = min(corner + TILE_PX, ivec2(push.size));
    uint points = 0u;
    bool continuous = true;
    float nearest = FARTHEST;
    ivec2 nearest_at = corner;
    for (int y = corner.y; y < end.y; ++y) {
        float z = imageLoad(depth, ivec2(corner.x, y)).r;
        for (int x = corner.x; x < end.x; ++x) {
            // Beyond the picture's edge the last pixel is its own neighbour.
            float right = imageLoad(depth, ivec2(min(x + 1, last.x), y)).r;
            float below = imageLoad(depth, ivec2(x, min(y + 1, last.y))).r;
            points += z <= FARTHEST ? 1u : 0u;
            nearest_at = z < nearest ? ivec2(x, y) : nearest_at;
            nearest = min(nearest, z);
            continuous = continuous && adjoin(z, right) && adjoin(z, below);
            z = right;
        }
    }
    // Of the nearest surface: how many pixels of each quarter, and how many that have one of it to their right, or below.
    uint front = 0u;
    uint pairs = 0u;
    uint above = 0u;
    for (int y = corner.y; y < end.y; ++y) {
        uint row = 0u;
        for (int x = corner.x; x < end.x; ++x) {
            float z = imageLoad(depth, ivec2(x, y)).r;
            row |= uint(z <= FARTHEST && in_front(z, nearest, push.front_px, push.px_per_unit, PERSPECTIVE)) << (x - corner.x);
        }
        front += (uint(bitCount(row & 15u)) | uint(bitCount(row >> 4)) << 8) << (16 * ((y - corner.y) / (TILE_PX / 2)));
        pairs += uint(bitCount(row & row >> 1) + bitCount(row & above));
        above = row;
    }
    // Quarters in which the picture ends.
    ivec2 whole = (end - corner) / (TILE_PX / 2);
    front &= (whole.x == 2 ? 0xFFFFFFFFu : whole.x == 1 ? 0x00FF00FFu : 0u) & (whole.y == 2 ? 0xFFFFFFFFu : whole.y == 1 ? 0x0000FFFFu : 0u);
    uint node = imageLoad(index, nearest_at).r >> POINTS_PER_PAGE_LOG2;
    float spacing = uintBitsToFloat(imageLoad(spacings, points > 0u ? int(node) : 0).r);
    float spacing_px = spacing * push.px_per_unit / (PERSPECTIVE ? nearest : 1.0);
    tiles.tile[number] = Tile(points, front, pairs, continuous ? 1u : 0u, nearest, points > 0u ? spacing_px : 0.0);
}
