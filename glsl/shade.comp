// Colour times the shade of shape depiction.
#version 460
#extension GL_EXT_scalar_block_layout : require

layout(local_size_x = 64) in;

layout(rgba32f) readonly uniform image2D color;
layout(r32f) readonly uniform image2D shade;
layout(rgba32f) writeonly uniform image2D shaded;

layout(push_constant, scalar) uniform Push {
    uvec2 size; // pixels
    float keep; // 1: the points' colours; 0: white
} push;

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (pixel.x >= int(push.size.x) || pixel.y >= int(push.size.y)) return;
    vec4 c = imageLoad(color, pixel);
    float s = imageLoad(shade, pixel).r;
    precise vec3 lit = (push.keep * c.rgb + (1.0 - push.keep)) * s;
    imageStore(shaded, pixel, vec4(c.a > 0.0 ? lit : vec3(0.0), c.a));
}
