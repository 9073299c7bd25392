// Smoothing of listed tiles (Dobrev et al. 2010, sec. 3.4; guide: papers): depth and colour -> the
// weighted mean of the 3 x 3, for pixels with something filled in it, over those with a depth.
//
//   alleviated Gaussian   1  2  1     Gaussian   1  2  1     box   1  1  1
//                         2 16  2                2  4  2           1  1  1
//                         1  2  1                1  2  1           1  1  1
// Weights are integers, divided by the sum of those that counted. Means are of differences to the
// pixel's own value, so that constants stay the same to the last bit (guide: numerics, case 26).
// Background neither gives nor takes. A measured pixel stays as it is if all around it were
// measured.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "pixel.glsl"
#include "tile.glsl"

layout(local_size_x = 64) in;

layout(scalar) readonly buffer Lists { uint word[]; } lists;
// From smooth_tiles.comp.
layout(scalar) readonly buffer Pixels { uint column[]; } pixels;
layout(r32f) readonly uniform image2D depth;
layout(rgba32f) readonly uniform image2D color;
// Visibility of the light.
layout(rgba32f) readonly uniform image2D shadow_factor;
layout(r32f) writeonly uniform image2D smooth_depth;
layout(rgba32f) writeonly uniform image2D smooth_color;
layout(rgba32f) writeonly uniform image2D smooth_shadow_factor;

layout(constant_id = 0) const bool SHADOWED = false;

layout(push_constant, scalar) uniform Push {
    uvec2 tiles;
    vec3 weights; // of the pixel, its sides and its corners
} push;

// A power of two that keeps sums finite, and its inverse.
const float SMALL = 0.015625;
const float LARGE = 64.0;

// Three adjacent pixels.
struct Row {
    float depths[3];
    vec4 colors[3];
    vec4 shadow_factor[3];
};

bool known(float z) {
    return has_depth(floatBitsToUint(z)) && z > 0.0;
}

Row row_at(ivec2 pixel) {
    Row row;
    [[unroll]] for (int k = 0; k < 3; ++k) {
        ivec2 at = pixel + ivec2(k - 1, 0);
        row.depths[k] = imageLoad(depth, at).r;
        row.colors[k] = imageLoad(color, at);
        row.shadow_factor[k] = SHADOWED ? imageLoad(shadow_factor, at) : vec4(0.0);
    }
    return row;
}

// Returns a bit for each pixel of a tile's column with something filled in its 3 x 3.
uint near_filled(ivec2 tile, int column) {
    uint near = 0u;
    [[unroll]] for (int aside = -1; aside <= 1; ++aside) {
        int x = TILE_PX * tile.x + column + aside;
        if (x < 0 || x >= TILE_PX * int(push.tiles.x)) continue;
        uint above = uint(max(tile.y - 1, 0)) * push.tiles.x * 8u + uint(x);
        uint own = uint(tile.y) * push.tiles.x * 8u + uint(x);
        uint below = uint(min(tile.y + 1, int(push.tiles.y) - 1)) * push.tiles.x * 8u + uint(x);
        near |= pixels.column[own] << 1;
        near |= tile.y > 0 ? pixels.column[above] >> 7 : 0u;
        near |= tile.y + 1 < int(push.tiles.y) ? (pixels.column[below] & 1u) << 9 : 0u;
    }
    return (near | near << 1 | near >> 1) >> 1;
}

void work(uint n) {
    uint number = lists.word[LIST_HEADER + n];
    ivec2 tile = in_rows(number, push.tiles.x);
    int column = int(gl_LocalInvocationID.x % 8u);
    ivec2 pixel = TILE_PX * tile + ivec2(column, 0);
    uint blend = near_filled(tile, column);
    Row above = row_at(pixel - ivec2(0, 1));
    Row own = row_at(pixel);
    // A column from top to bottom: its pixels share rows.
    [[dont_unroll]] for (int line = 0;; ++line) {
        Row below = row_at(pixel + ivec2(0, 1));
        Row rows[3] = Row[3](above, own, below);
        float z0 = own.depths[1];
        vec4 c0 = own.colors[1];
        vec4 m0 = own.shadow_factor[1];
        bool has = known(z0);
        float weights = push.weights.x;
        float rise = 0.0;
        vec3 change = vec3(0.0);
        vec3 change_shadow_factor = vec3(0.0);
        [[unroll]] for (int k = 0; k < 8; ++k) {
            int across = (k + k / 4) % 3;
            int down = (k + k / 4) / 3;
            float z = rows[down].depths[across];
            bool counts = has && known(z);
            float weight = mix(0.0, across == 1 || down == 1 ? push.weights.y : push.weights.z, counts);
            weights += weight;
            // If it does not count, the difference may be of infinities; between the farthest
            // depths it must not become one.
            rise += weight * mix(0.0, (z - z0) * SMALL, counts);
            change += vec3(weight) * (rows[down].colors[across].rgb - c0.rgb);
            if (SHADOWED) change_shadow_factor += vec3(weight) * (rows[down].shadow_factor[across].rgb - m0.rgb);
        }
        bool blends = (blend >> line & 1u) == 1u;
        float share = mix(0.0, 1.0 / weights, blends);
        // Pixels beyond the picture are not written.
        imageStore(smooth_depth, pixel, vec4(mix(z0, z0 + rise * share * LARGE, has && blends)));
        imageStore(smooth_color, pixel, vec4(c0.rgb + change * vec3(share), c0.a));
        if (SHADOWED) imageStore(smooth_shadow_factor, pixel, vec4(m0.rgb + change_shadow_factor * vec3(share), m0.a));
        if (line == TILE_PX - 1) break;
        pixel.y += 1;
        above = own;
        own = below;
    }
}

void main() {
    EACH_OF(lists.word[3], work)
}
