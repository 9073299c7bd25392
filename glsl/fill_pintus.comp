// One step of anisotropic filling (Pintus et al. 2011, sec. 5; papers/README.md): from one image into the other, only pixels to fill.
//
//   without a value: the lower median, by depth, of the neighbours' values in the 3 x 3, with that neighbour's colour
//   with one:        the mean of the neighbourhood, weighted by (1 - r / 2) (1 - min(1, |z - z0| / tolerance))
// Background never gives a value. Depths are averaged as differences to the pixel's own.
//
// A tile in whose neighbourhood nothing changed in the step before is left alone: both images hold the same there. `steps` is four words a step: three of the
// dispatch, which is empty when nothing changed in the step before, and one spare; then for every tile the last step that changed it.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "tile.glsl"
#include "pixel.glsl"

layout(local_size_x = 64) in;

layout(scalar) readonly buffer Lists { uint word[]; } lists;
layout(scalar) buffer Steps { uint word[]; } steps;
layout(rg32ui) readonly uniform uimage2D from;
layout(rg32ui) writeonly uniform uimage2D to;

layout(push_constant, scalar) uniform Push {
    uvec2 size;      // pixels
    uvec2 tiles;
    uint at;         // the list of tiles with pixels to fill
    uint step;       // from 1
    uint changed_at; // the first tile's word in `steps`
    float tolerance; // of depth: metres, or, where it is relative, parts of the depth
    uint relative;
    uint surrounded; // background is filled, too, where so many of its neighbours have a value
} push;

const uint NOTHING = 0xFFFFFFFFu;

uvec2 value_at(ivec2 pixel) {
    return imageLoad(from, pixel).rg;
}

// Neighbours that have a value.
uint valid_of(uvec2 above[3], uvec2 level[3], uvec2 below[3]) {
    uint valid = (has_depth(level[0].x) ? 1u : 0u) + (has_depth(level[2].x) ? 1u : 0u);
    [[unroll]] for (int k = 0; k < 3; ++k) valid += (has_depth(above[k].x) ? 1u : 0u) + (has_depth(below[k].x) ? 1u : 0u);
    return valid;
}

uvec2 mean(uvec2 own, uvec2 around[8]) {
    float z0 = uintBitsToFloat(own.x & ~FILLING);
    precise float tolerance = push.relative == 1u ? push.tolerance * z0 : push.tolerance;
    // Where there is no tolerance, only equal depths are of one surface.
    precise float strictness = tolerance > 0.0 ? 1.0 / tolerance : 3.402823466e38;
    precise float weights = 1.0;
    precise float rise = 0.0;
    precise vec3 light = light_of(own.y);
    [[unroll]] for (int k = 0; k < 8; ++k) {
        bool corner = k == 0 || k == 2 || k == 5 || k == 7;
        bool has = around[k].x != NOTHING;
        precise float difference = (has ? uintBitsToFloat(around[k].x) : z0) - z0;
        precise float near = 1.0 - min(1.0, abs(difference) * strictness);
        precise float weight = has ? (corner ? 0.292893219 : 0.5) * near : 0.0;
        weights += weight;
        rise += weight * difference;
        light += weight * light_of(around[k].y);
    }
    precise float step = rise / weights;
    // A thousandth of what tells surfaces apart shows nowhere, and would keep the tile awake for long.
    precise float z = abs(step) * 1024.0 < tolerance ? z0 : z0 + step;
    return uvec2(floatBitsToUint(z) | FILLING, pack_light(light / weights));
}

uvec2 median(uvec2 own, uvec2 around[8]) {
    uint valid = 0u;
    [[unroll]] for (int k = 0; k < 8; ++k) valid += around[k].x != NOTHING ? 1u : 0u;
    uint rank = (valid - 1u) / 2u;
    uvec2 found = own;
    [[unroll]] for (int k = 0; k < 8; ++k) {
        uint before = 0u;
        [[unroll]] for (int i = 0; i < 8; ++i) {
            if (i != k) before += around[i].x < around[k].x || (around[i].x == around[k].x && i < k) ? 1u : 0u;
        }
        found = valid > 0u && before == rank ? uvec2(around[k].x | FILLING, around[k].y) : found;
    }
    return found;
}

void main() {
    ivec2 size = ivec2(push.size);
    EACH_OF(lists.word[push.at + 3u]) {
        uint tile = lists.word[push.at + LIST_HEADER + n];
        ivec2 own_tile = ivec2(tile % push.tiles.x, tile / push.tiles.x);
        bool awake = push.step == 1u;
        for (int k = 0; k < 9 && !awake; ++k) {
            ivec2 at = clamp(own_tile + ivec2(k % 3, k / 3) - 1, ivec2(0), ivec2(push.tiles) - 1);
            // A neighbour may be changing right now: then it is taken for changed, which costs time and nothing else.
            awake = steps.word[push.changed_at + uint(at.y) * push.tiles.x + uint(at.x)] + 1u >= push.step;
        }
        ivec2 top = column_of(tile, push.tiles.x);
        uvec2 above[3];
        uvec2 level[3];
        uvec2 below[3];
        [[unroll]] for (int k = 0; k < 3; ++k) {
            above[k] = value_at(top + ivec2(k - 1, -1));
            level[k] = value_at(top + ivec2(k - 1, 0));
        }
        bool changed = false;
        // Loops for conditions, here and below: lavapipe leaves a loop that no lane runs, and walks through a branch that none takes.
        for (int row = awake && top.x < size.x ? 0 : TILE_PX; row < TILE_PX; ++row) {
            ivec2 pixel = top + ivec2(0, row);
            [[unroll]] for (int k = 0; k < 3; ++k) below[k] = value_at(pixel + ivec2(k - 1, 1));
            uint valid = valid_of(above, level, below);
            bool hole = (level[1].x & FILLING) != 0u || (level[1].x == BACKGROUND_BITS && valid >= push.surrounded);
            for (bool filling = pixel.y < size.y && hole; filling; filling = false) {
                uvec2 around[8] = { above[0], above[1], above[2], level[0], level[2], below[0], below[1], below[2] };
                [[unroll]] for (int k = 0; k < 8; ++k) around[k].x = has_depth(around[k].x) ? around[k].x & ~FILLING : NOTHING;
                uvec2 next = level[1];
                for (bool one = has_depth(next.x); one; one = false) next = mean(level[1], around);
                for (bool none = !has_depth(level[1].x); none; none = false) next = median(level[1], around);
                changed = changed || next != level[1];
                imageStore(to, pixel, uvec4(next, 0u, 0u));
            }
            above = level;
            level = below;
        }
        if (changed) {
            steps.word[push.changed_at + tile] = push.step;
            steps.word[4u * push.step + 4u] = lists.word[push.at];
            steps.word[4u * push.step + 5u] = 1u;
            steps.word[4u * push.step + 6u] = 1u;
        }
    }
}
