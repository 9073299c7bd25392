// Result of filling by masks -> G-buffer: the depth of every pixel, and index and colour of its
// source. Pixels that nothing reached are background.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "pixel.glsl"
#include "depth_source.glsl"
#include "tile.glsl"
#include "tile_mask.glsl"

layout(local_size_x = 64) in;

// Four rows per texel; sources as in lib/depth_source.glsl.
layout(rgba32f) readonly uniform image2D filled;
layout(rgba32f) readonly uniform image2D source;
layout(r32ui) readonly uniform uimage2D index;
layout(rgba32f) readonly uniform image2D color;
layout(r32f) writeonly uniform image2D filled_depth;
layout(r32ui) writeonly uniform uimage2D filled_index;
layout(rgba32f) writeonly uniform image2D filled_color;

layout(push_constant, scalar) uniform Push {
    uvec2 size; // pixels
} push;

void close(ivec2 texel) {
    if (texel.x >= int(push.size.x)) return;
    vec4 depths = imageLoad(filled, texel);
    vec4 sources = imageLoad(source, texel);
    [[unroll]] for (int row = 0; row < 4; ++row) {
        ivec2 pixel = ivec2(texel.x, 4 * texel.y + row);
        ivec2 from = pixel + way_to(sources[row]);
        bool has = has_depth(floatBitsToUint(depths[row]));
        uvec4 id = imageLoad(index, from);
        vec4 taken = imageLoad(color, from);
        if (pixel.y < int(push.size.y)) {
            imageStore(filled_depth, pixel, vec4(has ? depths[row] : uintBitsToFloat(BACKGROUND_BITS)));
            imageStore(filled_index, pixel, has ? id : uvec4(NO_POINT));
            imageStore(filled_color, pixel, has ? taken : vec4(0.0));
        }
    }
}

void main() {
    EACH_OWN_TEXEL(4, close)
}
