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
#extension GL_GOOGLE_include_directive : require

#include "tile.glsl"
#include "pixel.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

layout(scalar) readonly buffer Lists { uint word[]; } lists;
layout(scalar) buffer Steps { uint word[]; } steps;
layout(rg32ui) readonly uniform uimage2D from;
layout(rg32ui) writeonly uniform uimage2D to;

layout(constant_id = 0) const bool PERSPECTIVE = true;

layout(push_constant, scalar) uniform Push {
    uvec2 size;      // pixels
    uvec2 tiles;
    uint at;         // the list of tiles with pixels to fill
    uint step;       // from 1
    uint changed_at; // the first tile's word in `steps`
    float tolerance; // of depth: metres, or, where it is relative, parts of the depth
    uint relative;
} push;

void main() {
    ivec2 size = ivec2(push.size);
    uint count = lists.word[push.at + 3u];
    for (uint n = gl_WorkGroupID.x; n < count; n += gl_NumWorkGroups.x) {
        uint tile = lists.word[push.at + LIST_HEADER + n];
        bool awake = push.step == 1u;
        ivec2 own = ivec2(tile % push.tiles.x, tile / push.tiles.x);
        for (int k = 0; k < 9; ++k) {
            ivec2 at = clamp(own + ivec2(k % 3, k / 3) - 1, ivec2(0), ivec2(push.tiles) - 1);
            // A neighbour may be changing right now: then it is taken for changed, which costs time and nothing else.
            awake = awake || steps.word[push.changed_at + uint(at.y) * push.tiles.x + uint(at.x)] + 1u >= push.step;
        }
        ivec2 pixel = own * TILE_PX + ivec2(gl_LocalInvocationID.xy);
        bool inside = pixel.x < size.x && pixel.y < size.y;
        uvec2 value = imageLoad(from, clamp(pixel, ivec2(0), size - 1)).rg;
        // A loop, because lavapipe leaves a loop that no lane runs and walks through a branch that none takes.
        for (bool filling = awake && inside && (value.x & FILLING) != 0u; filling; filling = false) {
            uint bits[8];
            uint colors[8];
            uint valid = 0u;
            for (int k = 0; k < 8; ++k) {
                ivec2 d = ivec2((k < 4 ? k : k + 1) % 3, (k < 4 ? k : k + 1) / 3) - 1;
                ivec2 q = pixel + d;
                bool there = q.x >= 0 && q.y >= 0 && q.x < size.x && q.y < size.y;
                uvec2 neighbour = imageLoad(from, clamp(q, ivec2(0), size - 1)).rg;
                bool has = there && has_depth(neighbour.x);
                bits[k] = has ? neighbour.x & ~FILLING : 0xFFFFFFFFu;
                colors[k] = neighbour.y;
                valid += has ? 1u : 0u;
            }
            uvec2 next = value;
            if (has_depth(value.x)) {
                float z0 = uintBitsToFloat(value.x & ~FILLING);
                precise float tolerance = push.relative == 1u ? push.tolerance * z0 : push.tolerance;
                precise float weights = 1.0;
                precise float rise = 0.0;
                precise vec3 color = unpack_color(value.y);
                for (int k = 0; k < 8; ++k) {
                    bool corner = k == 0 || k == 2 || k == 5 || k == 7;
                    bool has = bits[k] != 0xFFFFFFFFu;
                    precise float difference = (has ? uintBitsToFloat(bits[k]) : z0) - z0;
                    precise float near = tolerance > 0.0 ? 1.0 - min(1.0, abs(difference) / tolerance) : difference == 0.0 ? 1.0 : 0.0;
                    precise float weight = has ? (corner ? 0.292893219 : 0.5) * near : 0.0;
                    weights += weight;
                    rise += weight * difference;
                    color += weight * unpack_color(colors[k]);
                }
                precise float z = z0 + rise / weights;
                next = uvec2(floatBitsToUint(z) | FILLING, pack_color(color / weights));
            } else if (valid > 0u) {
                uint rank = (valid - 1u) / 2u;
                for (int k = 0; k < 8; ++k) {
                    uint before = 0u;
                    for (int i = 0; i < 8; ++i) {
                        before += bits[i] < bits[k] || (bits[i] == bits[k] && i < k) ? 1u : 0u;
                    }
                    next = before == rank ? uvec2(bits[k] | FILLING, colors[k]) : next;
                }
            }
            imageStore(to, pixel, uvec4(next, 0u, 0u));
            if (next != value) {
                steps.word[push.changed_at + tile] = push.step;
                steps.word[4u * push.step + 4u] = lists.word[push.at];
                steps.word[4u * push.step + 5u] = 1u;
                steps.word[4u * push.step + 6u] = 1u;
            }
        }
    }
}
