// One step of filling by masks (Dobrev et al. 2010, sec. 3.2 and 3.3; guide: papers), from one
// image into the other.
//
//   masks       five consecutive pixels of the ring of eight, in all eight rotations
//   behind      background step: without depth
//               hidden step: not nearer than the pixel by at least the layer distance
//   pixel       background step: without depth; hidden step: with depth
//   stays       if all five pixels of any mask are behind: it lies beyond a silhouette
//   else        takes the values of its nearest neighbour
// Values are copied, never mixed: a depth carries its source and the steps that it may still go
// (lib/depth_source.glsl). Neighbours with none left are not used.
//
// If a pass before has found holes and hidden pixels, the background step fills those whatever
// masks say. Other pixels are filled if at most three of their eight neighbours are behind, which
// no straight silhouette has beside it: masks would grow it up to the diagonal for as many steps as
// holes take. The background step takes the nearest neighbour's values as soon as there are some,
// however far they have come.
//
// Tiles where nothing changed in the step before are skipped (lib/tile_steps.glsl). Depths only
// fall, so steps end.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "tile.glsl"
#include "tile_mask.glsl"
#include "pixel.glsl"
#include "neighborhood.glsl"
#include "depth_source.glsl"
#include "hole_masks.glsl"

layout(local_size_x = 64) in;

layout(scalar) buffer Steps { uint word[]; } steps;
layout(r32ui) readonly uniform uimageBuffer step_words;
// Four rows per texel.
layout(rgba32f) readonly uniform image2D from_depth;
layout(rgba32f) readonly uniform image2D from_source;
layout(rgba32f) writeonly uniform image2D to_depth;
layout(rgba32f) writeonly uniform image2D to_source;

layout(constant_id = 0) const bool TEXELS = true;
layout(constant_id = 1) const bool OCCLUDED = false;
// True if holes are known.
layout(constant_id = 2) const bool FOUND = false;

layout(push_constant, scalar) uniform Push {
    uvec2 size;       // pixels
    uvec2 tiles;
    uint step;        // number, from 1
    uint woken_at;  // the first tile's word in `steps`
    float layer;      // layer distance [m]
    uint most_groups; // limit of a dispatch
} push;

#include "tile_steps.glsl"

// From a pixel's place in a column of rows of three to the ring around it, clockwise from the upper
// left.
#define RING(k) ((k) < 3 ? (k) - 4 : (k) == 3 ? 1 : (k) < 7 ? 8 - (k) : -1)
// The 3 x 3 without its middle, row by row.
#define AROUND(k) ((k) - 4 + (k) / 4)
#define ASIDE(k) ivec2(((k) + (k) / 4) % 3 - 1, ((k) + (k) / 4) / 3 - 1)

const float FARTHEST = 3.402823466e38;
const int MOST_BEHIND = 3;

uint tile_at(uint place) {
    return LISTED ? listed_number(place, push.tiles.x) : place;
}

Changes work(uint tile) {
    ivec2 top = column_of(tile, push.tiles.x);
    Changes changes = NO_CHANGES;
    [[dont_unroll]] for (int half_tile = 0;; ++half_tile) {
        ivec2 texel = ivec2(top.x, top.y / 4 + half_tile);
        float z[18];
        LOAD_AROUND(z, from_depth, texel)
        vec4 next_source = imageLoad(from_source, texel);
        bvec4 holes = equal(next_source, vec4(TO_BE_FILLED));
        bvec4 filling;
        [[unroll]] for (int p = 0; p < 4; ++p) {
            int c = 3 * p + 4;
            bool has = z[c] < NO_DEPTH;
            float limit = OCCLUDED ? z[c] - push.layer : FARTHEST;
            uint behind = 0u;
            [[unroll]] for (int k = 0; k < 8; ++k) {
                float neighbour = z[c + RING(k)];
                // The second comparison is for layers thinner than an ulp: equal depths hide
                // nothing.
                behind |= uint(!(neighbour <= limit && neighbour < z[c])) << k;
            }
            bool inside = all(lessThan(ivec2(texel.x, 4 * texel.y + p), ivec2(push.size)));
            bool stays = FOUND ? !(holes[p] && !OCCLUDED) && bitCount(behind) > MOST_BEHIND : any_mask(behind);
            filling[p] = inside && has == OCCLUDED && !stays;
        }
        vec4 next = vec4(z[4], z[7], z[10], z[13]);
        if (any(filling)) {
            float source[18];
            [[unroll]] for (int k = 0; k < 3; ++k) {
                ivec2 at = texel + ivec2(k - 1, 0);
                vec4 own = imageLoad(from_source, at);
                source[k] = imageLoad(from_source, at - ivec2(0, 1)).w;
                [[unroll]] for (int p = 0; p < 4; ++p) source[3 * p + 3 + k] = own[p];
                source[15 + k] = imageLoad(from_source, at + ivec2(0, 1)).x;
            }
            [[unroll]] for (int p = 0; p < 4; ++p) {
                int c = 3 * p + 4;
                float limit = OCCLUDED ? z[c] - push.layer : FARTHEST;
                float nearest = NO_DEPTH;
                float nearest_source = 0.0;
                [[unroll]] for (int k = 0; k < 8; ++k) {
                    int i = c + AROUND(k);
                    bool nearer = (FOUND && !OCCLUDED || goes_on(source[i])) && z[i] < nearest && z[i] <= limit && z[i] < z[c];
                    nearest = mix(nearest, z[i], nearer);
                    nearest_source = mix(nearest_source, taken_from(source[i], ASIDE(k)), nearer);
                }
                filling[p] = filling[p] && nearest < NO_DEPTH;
                next[p] = mix(next[p], nearest, filling[p]);
                next_source[p] = mix(next_source[p], nearest_source, filling[p]);
            }
            add_changes(changes, half_tile, filling);
        }
        imageStore(to_depth, texel, next);
        imageStore(to_source, texel, next_source);
        if (half_tile == 1) break;
    }
    return changes;
}

void main() {
    take_step(LISTED ? listed_tiles() : push.tiles.x * push.tiles.y, gl_NumWorkGroups.x);
}
