// Colour times shading over the background -> linear picture; alpha is 1 on surfaces.
#version 460
#extension GL_EXT_scalar_block_layout : require

layout(local_size_x = 64) in;

layout(rgba32f) readonly uniform image2D color;
layout(r32f) readonly uniform image2D shading;
layout(rgba32f) writeonly uniform image2D picture;

layout(constant_id = 0) const bool HAS_SHADING = false;

layout(push_constant, scalar) uniform Push {
    uvec2 size;      // pixels
    vec3 background; // linear
} push;

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (pixel.x >= push.size.x || pixel.y >= push.size.y) return;
    vec4 c = imageLoad(color, pixel);
    if (HAS_SHADING) c.rgb *= imageLoad(shading, pixel).r;
    imageStore(picture, pixel, vec4(c.rgb + push.background * (1.0 - c.a), c.a));
}
