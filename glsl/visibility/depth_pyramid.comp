// A level of the pyramid of nearest points (lib/depth_pyramid.glsl) -> the next coarser one: the
// nearest point of each 2 x 2; among equals the first, row by row.
//
// The keys of a half-size picture would be the minima over 2 x 2, since a minimum is associative.
// So each level is the cloud projected at that resolution.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "pixel.glsl"
#include "depth_pyramid.glsl"

layout(local_size_x = 64) in;

layout(r32f) readonly uniform image2D depth;
layout(rgba32f) uniform image2D pyramid;

// True if this is level 1, which is made from the picture.
layout(constant_id = 0) const bool FIRST = true;
layout(constant_id = 1) const bool PERSPECTIVE = true;

layout(push_constant, scalar) uniform Push {
    uvec2 size; // pixels of the picture
    int level;  // level that is made
    float reach; // of a cell's nearest surface behind its nearest point: a factor, or [m]
} push;

void main() {
    ivec2 size = ivec2(push.size);
    ivec2 cell = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(cell, level_size(size, push.level)))) return;
    ivec2 last = level_size(size, push.level - 1) - 1;
    ivec2 from = level_corner(size, push.level - 1);
    float side = float(1 << (push.level - 1));
    const float NONE = uintBitsToFloat(BACKGROUND_BITS);
    float depths[4];
    float fronts[4];
    float nearest = NONE;
    vec2 place = vec2(0.0);
    float points = 0.0;
    [[unroll]] for (int k = 0; k < 4; ++k) {
        ivec2 fine = 2 * cell + ivec2(k % 2, k / 2);
        ivec2 at = min(fine, last);
        vec4 own = FIRST ? vec4(imageLoad(depth, at).r, 0.0, 1.0, 1.0) : imageLoad(pyramid, from + at);
        bool has = at == fine && own.r > 0.0 && own.r < NONE;
        depths[k] = has ? own.r : NONE;
        fronts[k] = own.b;
        points += has ? own.a : 0.0;
        place = has && own.r < nearest ? unpack_place(own.g) + side * vec2(k % 2, k / 2) : place;
        nearest = min(nearest, depths[k]);
    }
    float farthest = PERSPECTIVE ? nearest * push.reach : nearest + push.reach;
    float front = 0.0;
    [[unroll]] for (int k = 0; k < 4; ++k) front += depths[k] < NONE && depths[k] <= farthest ? fronts[k] : 0.0;
    imageStore(pyramid, level_corner(size, push.level) + cell, vec4(nearest, pack_place(place), front, points));
}
