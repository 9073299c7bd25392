// Strokes on the screen (stroke_screen) -> parallelograms of two triangles each.
#version 460
#extension GL_EXT_scalar_block_layout : require

layout(constant_id = 2) const bool TEXELS = true;

// The same as texels, and as words if texel buffers are too small.
layout(rgba32ui) readonly uniform uimageBuffer strokes;
layout(scalar) readonly buffer StrokeWords { uvec4 texel[]; } stroke_words;

layout(push_constant, scalar) uniform Push {
    vec2 corner; // position in the whole picture [px]
    vec2 size;
} push;

layout(location = 0) flat out vec4 centre_turning;
layout(location = 1) flat out vec4 axes;
layout(location = 2) flat out uvec4 rest;

uvec4 texel(uint i) {
    return TEXELS ? imageLoad(strokes, int(i)) : stroke_words.texel[i];
}

void main() {
    uint stroke = uint(gl_VertexIndex) / 6u;
    uint vertex = uint(gl_VertexIndex) - 6u * stroke;
    bool right = vertex == 1u || vertex == 2u || vertex == 4u;
    bool down = vertex == 2u || vertex == 4u || vertex == 5u;
    vec4 sides = uintBitsToFloat(texel(4u * stroke));
    centre_turning = uintBitsToFloat(texel(4u * stroke + 1u));
    axes = uintBitsToFloat(texel(4u * stroke + 2u));
    rest = texel(4u * stroke + 3u);
    vec2 at = centre_turning.xy + (right ? sides.xy : -sides.xy) + (down ? sides.zw : -sides.zw) - push.corner;
    // Words of strokes outside of the picture are undefined.
    bool shows = any(notEqual(sides, vec4(0.0)));
    // Fragments compute their own depth.
    gl_Position = vec4(shows ? at / push.size * vec2(2.0) - vec2(1.0) : vec2(0.0), 0.5, 1.0);
}
