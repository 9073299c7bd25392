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
layout(r32f) uniform image2D pyramid;
layout(r32f) uniform image2D places;

// Whether this is level 1, which is made from the picture.
layout(constant_id = 0) const bool FIRST = true;

layout(push_constant, scalar) uniform Push {
    uvec2 size; // pixels of the picture
    int level;  // level that is made
} push;

void main() {
    ivec2 size = ivec2(push.size);
    ivec2 cell = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(cell, level_size(size, push.level)))) return;
    ivec2 last = level_size(size, push.level - 1) - 1;
    ivec2 from = level_corner(size, push.level - 1);
    float side = float(1 << (push.level - 1));
    float nearest = uintBitsToFloat(BACKGROUND_BITS);
    float place = NO_PLACE;
    float points = 0.0;
    [[unroll]] for (int k = 0; k < 4; ++k) {
        ivec2 fine = 2 * cell + ivec2(k % 2, k / 2);
        ivec2 at = min(fine, last);
        float z = FIRST ? imageLoad(depth, at).r : imageLoad(pyramid, from + at).r;
        float own = FIRST ? ONE_POINT : imageLoad(places, from + at).r;
        bool has = at == fine && z > 0.0 && z < uintBitsToFloat(BACKGROUND_BITS);
        bool nearer = has && z < nearest;
        points += has ? points_in(own) : 0.0;
        own -= ONE_POINT * points_in(own);
        nearest = nearer ? z : nearest;
        place = nearer ? own + side * (float(k % 2) + ROW_OF_PLACES * float(k / 2)) : place;
    }
    imageStore(pyramid, level_corner(size, push.level) + cell, vec4(nearest));
    imageStore(places, level_corner(size, push.level) + cell, vec4(place + ONE_POINT * min(points, MOST_POINTS)));
}
