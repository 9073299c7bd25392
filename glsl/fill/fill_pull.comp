// A level of a pyramid -> the next coarser one: each cell is the mean of the values in its 2 x 2
// that belong to the surface of most of their pixels (Grossman and Dally 1998, sec. 7; Marroquim,
// Kraus and Cavalcanti 2008, sec. 4).
//
// Places are averaged as well as depths. With perspective inverse depths are averaged, which are
// affine on planes, so that the mean lies on the plane of its points. Ratios to one of the depths
// are averaged, so that constants stay constant.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "pixel.glsl"

layout(local_size_x = 64) in;

// Depths of the picture, for level 1.
layout(r32f) readonly uniform image2D depth;
// Values of other levels: depth, place from the middle of the cell [cells], and number of pixels.
layout(rgba32f) readonly uniform image2D fine_places;
layout(rgba32f) readonly uniform image2D fine_color;
layout(rgba32f) writeonly uniform image2D places;
layout(rgba32f) writeonly uniform image2D color;

layout(constant_id = 0) const bool PERSPECTIVE = true;
// True if this is level 1, made from the picture.
layout(constant_id = 1) const bool FIRST = true;
// True if colours are labels, which are never mixed.
layout(constant_id = 2) const bool LABELS = false;

layout(push_constant, scalar) uniform Push {
    uvec2 fine_size;
    uvec2 size;
    float tolerance; // depth difference: metres, or a share of the depth if relative
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
    // The surface that holds most pixels; among equals the nearest.
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
