// Keys -> depth, index and colour images. Colours are premultiplied by the point's opacity, which
// is alpha.
//
// The attribute word of a point is read here once per pixel, not once per point while projecting.
// Colours come from one table of 256 linear colours, made on the CPU so that every driver gives the
// same bits: it decodes sRGB for `rgb`, is a ramp over lo..hi for scalars, and a palette for kinds.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_buffer_reference_uvec2 : require
#extension GL_GOOGLE_include_directive : require

#include "drawn_node.glsl"
#include "tile.glsl"
#include "tile_mask.glsl"

layout(local_size_x = 64) in;

// The same as texels, and as words if texel buffers are too small.
layout(r32ui) readonly uniform uimageBuffer keys;
layout(scalar) readonly buffer KeyWords { uint word[]; } key_words;
// Address of the page with each node's attribute, two words.
layout(scalar) readonly buffer Shown { uvec2 page[]; } shown;
// Address of the page with each node's kinds, likewise.
layout(scalar) readonly buffer Kinds { uvec2 page[]; } kinds;
// Factors of opacity (lib/point_kind.glsl).
layout(scalar) readonly buffer Opacities { float factor[]; } opacities;
// 256 colours of four f32.
layout(rgba32ui) readonly uniform uimageBuffer table;
layout(r32f) writeonly uniform image2D depth;
layout(r32ui) writeonly uniform uimage2D index;
layout(rgba32f) writeonly uniform image2D color;

layout(constant_id = 0) const uint MODE = 0u;
layout(constant_id = 1) const bool TEXELS = true;
// True if some points are transparent, and whether that depends on their kinds.
layout(constant_id = 2) const bool TRANSPARENT = false;
layout(constant_id = 3) const bool BY_KIND = false;
// True if another pass makes the colours (luminance.comp).
layout(constant_id = 4) const bool COLORLESS = false;
// True if this is a layer behind others.
layout(constant_id = 5) const bool BEHIND = false;

layout(push_constant, scalar) uniform Push {
    uvec2 size;  // pixels of this strip
    uint top;    // first row of this strip in the picture
    float lo;    // attribute words at the ends of the ramp
    float scale; // 255 / (hi - lo)
} push;

const uint NO_POINT = 0xFFFFFFFFu;
const uint INFINITY_BITS = 0x7F800000u;

#include "keys.glsl"
#include "point_color.glsl"
#include "color_lookup.glsl"

uint key_word(uint at) {
    return TEXELS ? imageLoad(keys, int(at)).r : key_words.word[at];
}

void resolve(ivec2 at) {
    // Listed pixels are those of the whole picture.
    if (LISTED) at.y -= int(push.top);
    if (at.y < 0 || any(greaterThanEqual(at, ivec2(push.size)))) return;
    uint k = uint(at.y) * push.size.x + uint(at.x);
    uint point = key_word(point_word(k));
    uint depth_bits = key_word(depth_word(k));
    ivec2 pixel = ivec2(at.x, at.y + int(push.top));
    bool empty = point == NO_POINT;
    imageStore(depth, pixel, vec4(uintBitsToFloat(empty ? INFINITY_BITS : depth_bits)));
    imageStore(index, pixel, uvec4(point));
    if (COLORLESS) return;
    vec4 c = vec4(0.0);
    if (!empty) c = painted(MODE == CONSTANT ? 0u : shown_word(point), push.lo, push.scale) * vec4(own_opacity(point));
    imageStore(color, pixel, c);
}

void main() {
    EACH_OWN_PIXEL(resolve)
}
