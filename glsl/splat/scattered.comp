// Depth, ids and colours of points -> those of points on surfaces, and the depth of the others.
//
// Points lie on a surface if their clump says so (src/index/format/scatter.rs).
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require

#include "pixel.glsl"
#include "clump.glsl"

layout(local_size_x = 64) in;

layout(r32f) readonly uniform image2D depth;
layout(r32ui) readonly uniform uimage2D index;
layout(rgba32f) readonly uniform image2D color;
layout(scalar) readonly buffer Clumps { Clump clump[]; } clumps;
layout(r32f) writeonly uniform image2D surface_depth;
layout(r32ui) writeonly uniform uimage2D surface_index;
layout(rgba32f) writeonly uniform image2D surface_color;
layout(r32f) writeonly uniform image2D scattered_depth;

layout(push_constant, scalar) uniform Push {
    uvec2 size;    // pixels
    float scatter; // least scatter of points that lie on no surface
} push;

void main() {
    ivec2 at = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(at, ivec2(push.size)))) return;
    float z = imageLoad(depth, at).r;
    uint point = imageLoad(index, at).r;
    bool scattered = point != NO_POINT && clumps.clump[clump_of(point)].scatter >= push.scatter;
    float none = uintBitsToFloat(BACKGROUND_BITS);
    imageStore(surface_depth, at, vec4(scattered ? none : z));
    imageStore(surface_index, at, uvec4(scattered ? NO_POINT : point));
    imageStore(surface_color, at, scattered ? vec4(0.0) : imageLoad(color, at));
    imageStore(scattered_depth, at, vec4(scattered ? z : none));
}
