// A level of a pyramid in, the next coarser one out: each cell the mean of those of its 2 x 2 that have a value and belong to the surface that most of their pixels show
// (Grossman and Dally 1998, sec. 7; Marroquim, Kraus and Cavalcanti 2008, sec. 4).
//
// A mean is of places as well as of depths. With perspective it is of inverse depths, which are affine on planes, so that the mean lies on the plane that its points lie on. Ratios to one of the depths
// are averaged: what is constant stays so.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "pixel.glsl"

layout(local_size_x = 64) in;

// Depths of the picture; level 1 is made of these.
layout(r32f) readonly uniform image2D depth;
// Values of other levels: depth, place in cells from the middle of the cell, and number of pixels.
layout(rgba32f) readonly uniform image2D fine_places;
layout(rgba32f) readonly uniform image2D fine_color;
layout(rgba32f) writeonly uniform image2D places;
layout(rgba32f) writeonly uniform image2D color;

layout(constant_id = 0) const bool PERSPECTIVE = true;
// True for level 1, which is made of the picture.
layout(constant_id = 1) const bool FIRST = true;
// True where colours are labels, which are never mixed.
layout(constant_id = 2) const bool LABELS = false;

layout(push_constant, scalar) uniform Push {
    uvec2 fine_size;
    uvec2 size;
    float tolerance; // of depth: metres, or, where it is relative, parts of the depth
    uint relative;
} push;

void main() {
    ivec2 cell = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(cell, ivec2(push.size)))) return;
    ivec2 last = ivec2(push.fine_size) - 1;
    vec4 place[4];
    [[unroll]] for (int k = 0; k < 4; ++k) {
        ivec2 at = 2 * cell + ivec2(k % 2, k / 2);
        vec4 found = FIRST ? vec4(imageLoad(depth, min(at, last)).r, 0.0, 0.0, 1.0) : imageLoad(fine_places, min(at, last));
        bool has = all(lessThanEqual(at, last)) && found.x >= 0.0 && has_depth(floatBitsToUint(found.x));
        place[k] = has ? found : vec4(uintBitsToFloat(BACKGROUND_BITS), vec3(0.0));
    }
    // The surface that holds most pixels; of equals the nearest.
    float like = uintBitsToFloat(BACKGROUND_BITS);
    float most = 0.0;
    [[unroll]] for (int k = 0; k < 4; ++k) {
        float z = place[k].x;
        float tolerance = push.relative == 1u ? push.tolerance * z : push.tolerance;
        float pixels = 0.0;
        [[unroll]] for (int i = 0; i < 4; ++i) pixels += abs(place[i].x - z) <= tolerance ? place[i].w : 0.0;
        bool better = place[k].w > 0.0 && (pixels > most || (pixels == most && z < like));
        like = better ? z : like;
        most = better ? pixels : most;
    }
    float tolerance = push.relative == 1u ? push.tolerance * like : push.tolerance;
    float count = 0.0;
    float sum = 0.0;
    vec2 offset = vec2(0.0);
    vec4 colors = vec4(0.0);
    vec4 label = vec4(0.0);
    float labelled = 0.0;
    [[unroll]] for (int k = 0; k < 4; ++k) {
        float z = place[k].x;
        bool has = place[k].w > 0.0 && abs(z - like) <= tolerance;
        float part = PERSPECTIVE ? like / z : z - like;
        vec4 c = imageLoad(fine_color, min(2 * cell + ivec2(k % 2, k / 2), last));
        count += has ? 1.0 : 0.0;
        sum += has ? part : 0.0;
        offset += has ? 0.5 * (place[k].yz + vec2(k % 2, k / 2) - 0.5) : vec2(0.0);
        colors += has ? c : vec4(0.0);
        // The label of most pixels.
        bool more = has && place[k].w > labelled;
        label = more ? c : label;
        labelled = more ? place[k].w : labelled;
    }
    bool valued = count > 0.0;
    float many = max(count, 1.0);
    float mean = PERSPECTIVE ? like / (valued ? sum / many : 1.0) : like + sum / many;
    imageStore(places, cell, vec4(valued ? mean : uintBitsToFloat(BACKGROUND_BITS), offset / many, most));
    imageStore(color, cell, LABELS ? label : colors / many);
}
