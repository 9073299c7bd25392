// Layers -> what filling by masks starts from, four rows a texel: depths, and of every pixel that it has its own values and how many steps these may go.
//
// Where no number of steps is asked for that is a few spacings of the point on the screen: gaps between points close, and no surface grows farther over its silhouette. Pixels of which a pass before
// has found that they show nothing that is to be seen are marked, and filled whatever masks say.
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
// Of every node of the frame, how far apart its points are: bits of a float, metres.
layout(r32ui) readonly uniform uimageBuffer spacings;
layout(rgba32f) writeonly uniform image2D opened;
layout(rgba32f) writeonly uniform image2D source;

layout(constant_id = 0) const bool PERSPECTIVE = true;

layout(push_constant, scalar) uniform Push {
    uvec2 texels;
    float px_per_unit; // perspective: focal length in pixels; orthographic: pixels per metre
    float reach;       // steps for each pixel that points are apart
    float most;        // steps
    uint asked;        // 1: that many for all
} push;

void open(ivec2 texel) {
    if (any(greaterThanEqual(texel, ivec2(push.texels)))) return;
    vec4 four;
    vec4 sources;
    [[unroll]] for (int row = 0; row < 4; ++row) {
        ivec2 pixel = ivec2(texel.x, 4 * texel.y + row);
        // What lies beyond the picture reads as 0: no depth.
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
