// First level of shape depiction (Pintus et al. 2011, sec. 6; lib/shape.glsl): depth -> shade,
// depth of the next level, and the tiles that need deeper levels.
//
// On a plane every level gives the same shade, so only tiles near others are listed. A deeper level
// looks one pixel farther: tiles within `shaded` rings of a non-planar one have another shade, and
// rings beyond keep their inputs right. `wanted`: 1 for a tile whose depth is needed, 3 if its
// shade is, too.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "pixel.glsl"
#include "neighborhood.glsl"
#include "shape.glsl"
#include "tile.glsl"

layout(local_size_x = 64) in;

// Four rows per texel.
layout(rgba32f) readonly uniform image2D depth;
layout(rgba32f) writeonly uniform image2D next;
layout(rgba32f) writeonly uniform image2D shade;
layout(scalar) buffer Lists { uint word[]; } lists;
layout(scalar) buffer Wanted { uint tile[]; } wanted;

layout(constant_id = 0) const bool PERSPECTIVE = true;

layout(push_constant, scalar) uniform Push {
    uvec2 size;  // pixels
    uvec2 tiles;
    float width; // width of `softness` pixels: metres, or a share of the depth with perspective
    int shaded;  // rings shaded by deeper levels; 0: there are none
    int rings;   // and rings whose depth they need
} push;

void want(ivec2 tile) {
    for (int y = max(tile.y - push.rings, 0); y <= min(tile.y + push.rings, int(push.tiles.y) - 1); ++y) {
        for (int x = max(tile.x - push.rings, 0); x <= min(tile.x + push.rings, int(push.tiles.x) - 1); ++x) {
            bool near = max(abs(x - tile.x), abs(y - tile.y)) <= push.shaded;
            uint at = uint(y) * push.tiles.x + uint(x);
            if ((atomicOr(wanted.tile[at], near ? 3u : 1u) & 3u) == 0u) APPEND(lists, 0u, at)
        }
    }
}

void work(uint n) {
    ivec2 top = column_of(n, push.tiles.x);
    bool plane = true;
    [[dont_unroll]] for (int half_tile = 0;; ++half_tile) {
        ivec2 texel = ivec2(top.x, top.y / 4 + half_tile);
        float z[18];
        LOAD_AROUND(z, depth, texel)
        vec4 omegas;
        vec4 nexts;
        [[unroll]] for (int p = 0; p < 4; ++p) {
            float around[9];
            [[unroll]] for (int k = 0; k < 9; ++k) around[k] = z[3 * p + k];
            Level level = level_of(around, push.width, PERSPECTIVE);
            omegas[p] = level.omega;
            nexts[p] = level.next;
            bool at_edge = any(equal(ivec2(texel.x, 4 * texel.y + p), ivec2(0))) || any(greaterThanEqual(ivec2(texel.x, 4 * texel.y + p), ivec2(push.size) - 1));
            plane = plane && (level.flat_ || at_edge);
        }
        imageStore(shade, texel, omegas);
        imageStore(next, texel, nexts);
        if (half_tile == 1) break;
    }
    // One lane of a tile marks it and its surroundings.
    if (!plane && push.shaded > 0 && (atomicOr(wanted.tile[n], 4u) & 4u) == 0u) want(in_rows(n, uint(push.tiles.x)));
}

void main() {
    EACH_OF(push.tiles.x * push.tiles.y, work)
}
