// G-buffer -> start of filling by masks, four rows per texel: depths, and every pixel as its own
// source with the number of steps it may go.
//
// Unless set, that is a few point spacings on the screen: gaps close, and no surface grows farther
// over its silhouette. Pixels that a pass before has found invisible are marked and filled whatever
// masks say.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "drawn_node.glsl"
#include "pixel.glsl"
#include "depth_source.glsl"
#include "tile.glsl"
#include "tile_mask.glsl"

layout(local_size_x = 64) in;

layout(r32f) readonly uniform image2D depth;
layout(r32ui) readonly uniform uimage2D index;
// Point spacing of every node of the frame [m], as float bits.
layout(r32ui) readonly uniform uimageBuffer spacings;
layout(rgba32f) writeonly uniform image2D opened;
layout(rgba32f) writeonly uniform image2D source;

layout(constant_id = 0) const bool PERSPECTIVE = true;

layout(push_constant, scalar) uniform Push {
    uvec2 texels;
    float px_per_unit; // perspective: focal length in pixels; orthographic: pixels per metre
    float reach;       // steps per pixel of point spacing
    float most;        // steps
    uint asked;        // 1: that number for all
} push;

void open(ivec2 texel) {
    if (any(greaterThanEqual(texel, ivec2(push.texels)))) return;
    vec4 four;
    vec4 sources;
    [[unroll]] for (int row = 0; row < 4; ++row) {
        ivec2 pixel = ivec2(texel.x, 4 * texel.y + row);
        // Pixels beyond the picture read 0: no depth.
        float z = imageLoad(depth, pixel).r;
        uint point = imageLoad(index, pixel).r;
        bool known = has_depth(floatBitsToUint(z)) && z > 0.0 && point != NO_POINT;
        float spacing = uintBitsToFloat(imageLoad(spacings, known ? int(point >> POINTS_PER_PAGE_LOG2) : 0).r);
        float spacing_px = spacing * push.px_per_unit / (PERSPECTIVE && known ? z : 1.0);
        four[row] = z;
        sources[row] = push.asked == 1u ? push.most : clamp(ceil(spacing_px * push.reach), 1.0, push.most);
        sources[row] = mix(sources[row] * STEP_LEFT, TO_BE_FILLED, floatBitsToUint(z) == UNKNOWN_BITS);
    }
    imageStore(opened, texel, four);
    imageStore(source, texel, sources);
}

void main() {
    EACH_OWN_TEXEL(4, open)
}
