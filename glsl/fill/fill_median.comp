// One step of anisotropic filling (Pintus et al. 2011, sec. 5; guide: papers), from one image into
// the other.
//
//   without a value: lower median, by depth, of the values in the 3 x 3, with that neighbour's colour
//   with one:        mean of the neighbourhood, weighted by
//                    (1 - r / 2) (1 - min(1, |z - z0| / tolerance))
// Background never gives a value. Depths are averaged as differences to the pixel's own. Selections
// use mix and not ?, which becomes a branch: some compilers take minutes over hundreds of branches.
//
// Tiles where nothing changed in the step before are skipped (lib/tile_steps.glsl).
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "tile.glsl"
#include "pixel.glsl"

layout(local_size_x = 64) in;

layout(scalar) readonly buffer Lists { uint word[]; } lists;
layout(r32ui) readonly uniform uimageBuffer listed_words;
// Width of the kernel that found each tile's holes [px].
layout(scalar) readonly buffer Kernels { uint word[]; } kernels;
layout(r32ui) readonly uniform uimageBuffer kernel_words;
layout(scalar) buffer Steps { uint word[]; } steps;
layout(r32ui) readonly uniform uimageBuffer step_words;
// Depth and colour (lib/pixel.glsl), four rows per texel.
layout(rgba32f) readonly uniform image2D from_depth;
layout(rgba32f) readonly uniform image2D from_color;
layout(rgba32f) writeonly uniform image2D to_depth;
layout(rgba32f) writeonly uniform image2D to_color;

layout(constant_id = 0) const bool TEXELS = true;
// True if colours are labels, which are never mixed.
layout(constant_id = 1) const bool LABELS = false;

layout(push_constant, scalar) uniform Push {
    uvec2 tiles;
    uint step;       // number, from 1
    uint woken_at; // the first tile's word in `steps`
    float tolerance; // depth difference: metres, or a share of the depth if relative
    uint relative;
    uint surrounded; // filled neighbours from which background is filled, too
    uint most_groups; // limit of a dispatch
} push;

// Smaller steps than the tolerance divided by this and by the kernel's width count as none: about
// two pixel widths divided by that of the kernel.
const float AT_REST = 16.0;
// Larger than the bits of any depth.
const int NOTHING = 0x7FFFFFFF;

// Returns bits without the sign; NOTHING without depth.
int depth_bits(uint word) {
    uint magnitude = word & ~FILLING;
    return mix(NOTHING, int(magnitude), magnitude - 1u < BACKGROUND_BITS - 1u);
}

#include "tile_steps.glsl"

// The 3 x 3 around place `c`, row by row, in a column of six rows of three.
#define AROUND(k, c) ((c) - 4 + (k) + (k) / 4)

uint tile_at(uint place) {
    return WORD(listed_words, lists, LIST_HEADER + place);
}

Changes work(uint tile) {
    ivec2 top = column_of(tile, push.tiles.x);
    // The sum of the steps to come grows with the square of a hole's width. With smaller steps for
    // wider holes, the remaining error is the same slope everywhere. Still smaller steps are
    // invisible, and would keep the tile awake for long.
    float at_rest = AT_REST * float(WORD(kernel_words, kernels, tile));
    Changes changes = NO_CHANGES;
    [[dont_unroll]] for (int half_tile = 0;; ++half_tile) {
        ivec2 texel = ivec2(top.x, top.y / 4 + half_tile);
        // Bits of depths without the sign, NOTHING without depth.
        int bits[18];
        uvec4 own = floatBitsToUint(imageLoad(from_depth, texel));
        [[unroll]] for (int k = 0; k < 3; ++k) {
            ivec2 at = texel + ivec2(k - 1, 0);
            uvec4 column = k == 1 ? own : floatBitsToUint(imageLoad(from_depth, at));
            bits[k] = depth_bits(floatBitsToUint(imageLoad(from_depth, at - ivec2(0, 1)).w));
            [[unroll]] for (int p = 0; p < 4; ++p) bits[3 * p + 3 + k] = depth_bits(column[p]);
            bits[15 + k] = depth_bits(floatBitsToUint(imageLoad(from_depth, at + ivec2(0, 1)).x));
        }
        bvec4 filling;
        bvec4 none;
        [[unroll]] for (int p = 0; p < 4; ++p) {
            int valid = 0;
            [[unroll]] for (int k = 0; k < 8; ++k) valid += int(bits[AROUND(k, 3 * p + 4)] != NOTHING);
            int needed = mix(mix(9, int(push.surrounded), own[p] == BACKGROUND_BITS), 1, (own[p] & FILLING) != 0u);
            filling[p] = valid >= needed;
            none[p] = all(bvec2(filling[p], bits[3 * p + 4] == NOTHING));
        }
        if (any(filling)) {
            float colors[18];
            vec4 own_colors = imageLoad(from_color, texel);
            [[unroll]] for (int k = 0; k < 3; ++k) {
                ivec2 at = texel + ivec2(k - 1, 0);
                vec4 column = k == 1 ? own_colors : imageLoad(from_color, at);
                colors[k] = imageLoad(from_color, at - ivec2(0, 1)).w;
                [[unroll]] for (int p = 0; p < 4; ++p) colors[3 * p + 3 + k] = column[p];
                colors[15 + k] = imageLoad(from_color, at + ivec2(0, 1)).x;
            }
            uvec4 next = own;
            vec4 next_colors = own_colors;
            [[unroll]] for (int p = 0; p < 4; ++p) {
                // The mean, if there is a value; otherwise unused.
                int c = 3 * p + 4;
                float z0 = intBitsToFloat(mix(bits[c], 0x3F800000, bits[c] == NOTHING));
                float tolerance = push.relative == 1u ? push.tolerance * z0 : push.tolerance;
                // Without a tolerance, only equal depths are of one surface.
                float strictness = tolerance > 0.0 ? min(1.0 / tolerance, 3.402823466e38) : 3.402823466e38;
                float weights = 1.0;
                float rise = 0.0;
                vec3 light = light_of(colors[c]);
                [[unroll]] for (int k = 0; k < 8; ++k) {
                    int i = AROUND(k, c);
                    bool corner = k == 0 || k == 2 || k == 5 || k == 7;
                    bool has = bits[i] != NOTHING;
                    float difference = mix(z0, intBitsToFloat(bits[i]), has) - z0;
                    float near = 1.0 - min(1.0, abs(difference) * strictness);
                    float weight = mix(0.0, (corner ? 0.292893219 : 0.5) * near, has);
                    weights += weight;
                    rise += weight * difference;
                    light += weight * light_of(colors[i]);
                }
                float share = 1.0 / weights;
                float step = rise * share;
                float z = mix(z0 + step, z0, abs(step) * at_rest < tolerance);
                bool mean = filling[p] != none[p];
                next[p] = mix(next[p], floatBitsToUint(z) | FILLING, mean);
                if (!LABELS) next_colors[p] = mix(next_colors[p], pack_light(light * share, opacity_bits(colors[c])), mean);
            }
            if (any(none)) {
                [[unroll]] for (int p = 0; p < 4; ++p) {
                    int c = 3 * p + 4;
                    int valid = 0;
                    [[unroll]] for (int k = 0; k < 8; ++k) valid += int(bits[AROUND(k, c)] != NOTHING);
                    int rank = mix(-1, (valid - 1) >> 1, none[p]);
                    [[unroll]] for (int k = 0; k < 8; ++k) {
                        int own_bits = bits[AROUND(k, c)];
                        int before = 0;
                        [[unroll]] for (int i = 0; i < 8; ++i) {
                            int other = bits[AROUND(i, c)];
                            if (i < k) before += int(other <= own_bits);
                            if (i > k) before += int(other < own_bits);
                        }
                        bool found = before == rank;
                        next[p] = mix(next[p], uint(own_bits) | FILLING, found);
                        next_colors[p] = mix(next_colors[p], colors[AROUND(k, c)], found);
                    }
                }
            }
            uvec4 differ = uvec4(notEqual(next, own)) | uvec4(notEqual(next_colors, own_colors));
            add_changes(changes, half_tile, bvec4(differ));
            imageStore(to_depth, texel, uintBitsToFloat(next));
            imageStore(to_color, texel, next_colors);
        }
        if (half_tile == 1) break;
    }
    return changes;
}

void main() {
    take_step(WORD(listed_words, lists, 3u), lists.word[0]);
}
