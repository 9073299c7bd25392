// A stroke in a pixel -> its key if it covers enough to hide what is behind, and ground near its
// own point.
//
// The rasteriser only chooses the pixels. Whether a stroke is in one, and at which depth, is
// computed as for fragments of the A-buffer, with the same bits.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require

layout(constant_id = 0) const bool PERSPECTIVE = true;
layout(constant_id = 2) const bool TEXELS = true;
// True if to write keys, not only ground.
layout(constant_id = 3) const bool PAINTED = true;

#include "stroke_constants.glsl"
#include "buffer_word.glsl"

layout(set = 1, scalar) readonly buffer Canvases { Canvas canvas[]; } canvases;
// The same as texels, and as words if texel buffers are too small.
layout(set = 1, r32ui) readonly uniform uimageBuffer brushes;
layout(set = 1, scalar) readonly buffer BrushWords { uint word[]; } brush_words;
// Two words per pixel, row by row: 1 on far ground and on near ground of a stroke, also behind
// others.
layout(set = 1, scalar) writeonly buffer Ground { uint word[]; } ground;

layout(location = 0) flat in vec4 centre_turning;
layout(location = 1) flat in vec4 axes;
layout(location = 2) flat in uvec4 rest;

layout(location = 0) out uvec2 key;

#include "brush.glsl"

// Bits of 1, and of 2^-40, below which depths are not distinguished: depths from there to 2^86 are
// as many as floats from 1 down to 2^-126.
const uint ONE = 127u << 23;
const uint NEAREST = 87u << 23;

void main() {
    Canvas canvas = canvases.canvas[0];
    Met met = meet(canvas.corner + gl_FragCoord.xy, centre_turning, axes, canvas.reach);
    float z = depth_of(met, uintBitsToFloat(rest.x));
    // One condition: software devices leave the stage if no pixel of a group is left.
    if (!met.is_on || z <= 0.0) discard;
    uint pixel = uint(gl_FragCoord.y) * canvas.size.x + uint(gl_FragCoord.x);
    float off = met.uv.x * met.uv.x + met.uv.y * met.uv.y;
    if (off <= canvas.ground * canvas.ground) ground.word[2u * pixel + (off <= abs(uintBitsToFloat(rest.w)) ? 1u : 0u)] = 1u;
    if (!PAINTED) discard;
    uint brush = rest.z >> 24;
    float alpha = coverage(met.uv, brush);
    if (rest.w >> 31 != 0u) alpha = max(alpha, second_coverage(met.uv, brush) * canvas.detail);
    if (alpha < canvas.hides) discard;
    uint bits = floatBitsToUint(z);
    key = uvec2(rest.y, bits);
    // Greater if nearer, and never the same for two depths.
    gl_FragDepth = uintBitsToFloat(ONE - (clamp(bits, NEAREST, NEAREST + ONE - (1u << 23)) - NEAREST));
}
