// Depth -> contents of each tile of 8 x 8 pixels.
//
// A tile is continuous if every pixel holds a point and no pixel is farther from its right and
// lower neighbours than `slope` pixel widths. Then no neighbour within a kernel hides a point of
// it: n steps away depths differ by at most n times that (the bound is in
// src/passes/visibility.rs).
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require

#include "drawn_node.glsl"
#include "tile.glsl"

layout(local_size_x = 64) in;

layout(r32f) readonly uniform image2D depth;
layout(r32ui) readonly uniform uimage2D index;
// Point spacing of every node of the frame [m], as float bits.
layout(r32ui) readonly uniform uimageBuffer spacings;
layout(scalar) writeonly buffer Tiles { Tile tile[]; } tiles;

layout(constant_id = 0) const bool PERSPECTIVE = true;

layout(push_constant, scalar) uniform Push {
    uvec2 size;        // pixels
    uvec2 tiles;
    float px_per_unit; // perspective: focal length in pixels; orthographic: pixels per metre
    float slope;
} push;

const float FARTHEST = 3.402823466e38;

// Returns whether two adjacent pixels hold points of one surface.
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
    uint points[2] = uint[2](0u, 0u);
    uint empty[2] = uint[2](0u, 0u);
    bool continuous = true;
    float farthest = 0.0;
    float nearest = FARTHEST;
    ivec2 nearest_at = corner;
    for (int y = corner.y; y < end.y; ++y) {
        float z = imageLoad(depth, ivec2(corner.x, y)).r;
        for (int x = corner.x; x < end.x; ++x) {
            // Edge pixels are their own neighbours.
            float right = imageLoad(depth, ivec2(min(x + 1, last.x), y)).r;
            float below = imageLoad(depth, ivec2(x, min(y + 1, last.y))).r;
            bool has = z > 0.0 && z <= FARTHEST;
            int half_tile = (x - corner.x) / 4;
            uint bit = 1u << (8 * ((x - corner.x) % 4) + y - corner.y);
            points[half_tile] |= has ? bit : 0u;
            empty[half_tile] |= z > FARTHEST ? bit : 0u;
            farthest = has ? max(farthest, z) : farthest;
            nearest_at = has && z < nearest ? ivec2(x, y) : nearest_at;
            nearest = has ? min(nearest, z) : nearest;
            continuous = continuous && has && adjoin(z, right) && adjoin(z, below);
            z = right;
        }
    }
    bool any = farthest > 0.0;
    uint node = imageLoad(index, nearest_at).r >> POINTS_PER_PAGE_LOG2;
    float spacing = uintBitsToFloat(imageLoad(spacings, any ? int(node) : 0).r) * push.px_per_unit / (PERSPECTIVE ? nearest : 1.0);
    tiles.tile[number] = Tile(points[0], points[1], empty[0], empty[1], continuous ? 1u : 0u, farthest, any ? spacing : 0.0);
}
