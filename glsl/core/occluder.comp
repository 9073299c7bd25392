// A copy of a host's depth -> planar depth of its geometry, behind which nothing is seen.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require

layout(local_size_x = 64) in;

// Rows from top to bottom: a float, or the lower 24 bits of a word, or half of one.
layout(scalar) readonly buffer Stored { uint word[]; } stored;
layout(r32f) writeonly uniform image2D occluder;

layout(constant_id = 0) const uint BITS = 32;
layout(constant_id = 1) const bool PERSPECTIVE = true;

layout(push_constant, scalar) uniform Push {
    uvec2 size;
    vec2 form; // a + b / z with perspective, a + b z without
    float far; // depth of what is infinitely far
} push;

float depth_at(uint pixel) {
    if (BITS == 16) {
        uint both = stored.word[pixel / 2];
        return float((pixel & 1u) == 0u ? both & 0xFFFFu : both >> 16) / 65535.0;
    }
    uint word = stored.word[pixel];
    return BITS == 24 ? float(word & 0xFFFFFFu) / 16777215.0 : uintBitsToFloat(word);
}

void main() {
    uvec2 at = gl_GlobalInvocationID.xy;
    if (any(greaterThanEqual(at, push.size))) return;
    float d = depth_at(at.y * push.size.x + at.x);
    float z = PERSPECTIVE ? push.form.y / (d - push.form.x) : (d - push.form.x) / push.form.y;
    imageStore(occluder, ivec2(at), vec4(d == push.far ? uintBitsToFloat(0x7F800000u) : z));
}
