// Anti-aliasing of silhouettes (Dobrev et al. 2010, sec. 3.5; HARD_CASES 12): colour in the light -> the same, blended with what lies around it where depth jumps.
//
//   inverse     edge = |laplacian(1/z)| * least z      0 on every plane, whose 1/z is affine with perspective; background is 1/z = 0
//   depth       edge = |laplacian(z)| / least z        the paper's: bends on steep planes; background is z = 0
//   silhouette  edge > jump; with the high threshold also background among the five pixels of the cross
//   blend       mean over the 3 x 3 with weights 1 2 1, 2 4 2, 1 2 1, of linear light times coverage
// Against background the edge is 1 and more for each side on which it lies, whatever the depth. The picture's edge is none: what lies beyond is as the pixel itself.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "pixel.glsl"
#include "tile.glsl"
#include "area.glsl"

layout(local_size_x = 64) in;

layout(r32f) readonly uniform image2D depth;
layout(rgba32f) readonly uniform image2D color;
layout(r32f) readonly uniform image2D lit;
layout(rgba32f) writeonly uniform image2D blended;
// Light that is left to be multiplied: none where colours are blended, since these were in their light already.
layout(r32f) writeonly uniform image2D left;

layout(constant_id = 0) const bool LIT_BY = false;
layout(constant_id = 1) const bool INVERSE = true;
layout(constant_id = 2) const bool HIGH = false;

layout(push_constant, scalar) uniform Push {
    uvec2 size; // pixels
    float jump; // least Laplacian of a silhouette, parts of the depth
} push;

// Depths beyond this many times the least are as far as that many times.
const float MOST = 1e6;

bool known(float z) {
    return has_depth(floatBitsToUint(z)) && z > 0.0;
}

void blend(ivec2 pixel) {
    ivec2 last = ivec2(push.size) - 1;
    if (any(greaterThan(pixel, last))) return;
    float z[5];
    float least = uintBitsToFloat(BACKGROUND_BITS);
    bool background = false;
    [[unroll]] for (int k = 0; k < 5; ++k) {
        // The pixel itself, left, right, above, below.
        ivec2 aside = ivec2(k == 1 ? -1 : k == 2 ? 1 : 0, k == 3 ? -1 : k == 4 ? 1 : 0);
        z[k] = imageLoad(depth, clamp(pixel + aside, ivec2(0), last)).r;
        bool has = known(z[k]);
        least = mix(least, min(least, z[k]), has);
        background = background || !has;
    }
    bool any_has = least < uintBitsToFloat(BACKGROUND_BITS);
    least = mix(1.0, least, any_has);
    float laplacian = 0.0;
    [[unroll]] for (int k = 0; k < 5; ++k) {
        bool has = known(z[k]);
        float own = mix(least, z[k], has);
        bool far = own > least * MOST;
        float ratio = INVERSE ? least / own : mix(own, least, far) / least;
        ratio = mix(ratio, MOST, far && !INVERSE);
        laplacian += (k == 0 ? 4.0 : -1.0) * mix(0.0, ratio, has);
    }
    bool silhouette = any_has && abs(laplacian) > push.jump && (background || !HIGH);
    vec4 c0 = imageLoad(color, pixel);
    float lit0 = LIT_BY ? imageLoad(lit, pixel).r : 1.0;
    vec4 sum = vec4(0.0);
    // A loop, and tested at its end (lib/tile.glsl says why).
    if (silhouette) for (int k = 0;; ++k) {
        ivec2 aside = ivec2(k % 3 - 1, k / 3 - 1);
        ivec2 at = clamp(pixel + aside, ivec2(0), last);
        float weight = float((2 - abs(aside.x)) * (2 - abs(aside.y)));
        vec4 c = imageLoad(color, at);
        float light = LIT_BY ? imageLoad(lit, at).r : 1.0;
        sum += vec4(weight) * vec4(c.rgb * vec3(light), c.a);
        if (k == 8) break;
    }
    imageStore(blended, pixel, mix(c0, sum * vec4(0.0625), bvec4(silhouette)));
    imageStore(left, pixel, vec4(mix(lit0, 1.0, silhouette)));
}

void main() {
    EACH_OWN_PIXEL(push.size.x, blend)
}
