// Phong lighting (Phong 1975; Dobrev et al. 2010, sec. 3.1): depth, colour -> shaded colour.
//
//   color' = color (ambient + m diffuse max(0, n.l)) + m specular max(0, r.v)^shininess
//   r = 2 (n.l) n - l
// m is the share of the light that reaches the surface if shadows are cast, else 1 (sec. 6: ka + m
// (kd + ks)). Normals are those of points if they have any (point_normals.comp): the pixel's own,
// or the mean of its neighbours on the same surface; else they are fitted to the depths
// (lib/fit_normal.glsl). They face the camera. A pixel without a normal is shaded as if it faced
// the light.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "pixel.glsl"
#include "tile.glsl"
#include "tile_mask.glsl"
#include "normalize.glsl"
#include "fit_normal.glsl"

layout(local_size_x = 64) in;

layout(r32f) readonly uniform image2D depth;
layout(rgba32f) readonly uniform image2D color;
// Normals of points (right, down, away) and 1; 0 where unknown. Unread if points have none.
layout(rgba32f) readonly uniform image2D facing;
// m in red, green and blue. Unread without shadows.
layout(rgba32f) readonly uniform image2D shadow_factor;
layout(rgba32f) writeonly uniform image2D shaded;

layout(constant_id = 0) const bool PERSPECTIVE = true;
layout(constant_id = 1) const bool OF_POINTS = false;
layout(constant_id = 2) const bool SHADOWED = false;

layout(push_constant, scalar) uniform Push {
    uvec2 size;        // pixels
    vec2 centre;       // principal point [px]
    float px_per_unit; // perspective: focal length in pixels; orthographic: pixels per metre
    float reach;       // depth difference of surfaces: metres, or a share with perspective
    int radius_px;     // of the neighbourhood
    // In camera axes (right, down, away): a position and 1, or the direction to an infinitely
    // distant light and 0.
    vec4 light;
    vec4 eye;
    float ambient;
    float diffuse;
    float specular;
    uint shininess;    // 1 to 255
} push;

#include "surface_normal.glsl"

// Returns the mean normal around a pixel of depth z. Neighbours closer in depth weigh more, as in
// add_to_fit.
vec3 mean_of_points(ivec2 pixel, float z, float reach) {
    vec3 sum = vec3(0.0);
    // See normal_at.
    ivec2 aside_px = ivec2(-push.radius_px);
    for (;;) {
        float other = imageLoad(depth, pixel + aside_px).r;
        vec4 n = imageLoad(facing, pixel + aside_px);
        bool counts = known(other) && abs(z - mix(z, other, known(other))) < reach;
        float part = (z - mix(z, other, counts)) / reach;
        float inner = 1.0 - part * part;
        sum += vec3(mix(0.0, inner * inner, counts)) * n.xyz;
        bool row_ends = aside_px.x == push.radius_px;
        aside_px = mix(aside_px + ivec2(1, 0), ivec2(-push.radius_px, aside_px.y + 1), bvec2(row_ends));
        if (aside_px.y > push.radius_px) break;
    }
    return unit(sum);
}

// Returns the direction from the place `ray` times its depth; 0 if both are the same. All is
// divided by the depth, since products with it may overflow.
vec3 towards(vec4 what, vec3 ray, float z) {
    return unit(mix(what.xyz, what.xyz / vec3(z) - ray, bvec3(what.w > 0.5)));
}

// Returns x to a whole power for 0 <= x <= 1, by squaring: the same bits everywhere, unlike `pow`.
float power(float x, uint exponent) {
    float result = 1.0;
    [[unroll]] for (int bit = 0; bit < 8; ++bit) {
        result *= mix(1.0, x, (exponent >> bit & 1u) == 1u);
        x *= x;
    }
    return result;
}

void shade(ivec2 pixel) {
    if (any(greaterThanEqual(pixel, ivec2(push.size)))) return;
    float z0 = imageLoad(depth, pixel).r;
    vec4 c = imageLoad(color, pixel);
    bool has = known(z0);
    float z = mix(1.0, z0, has);
    float reach = PERSPECTIVE ? push.reach * z : push.reach;
    vec2 from_centre = vec2(pixel) + 0.5 - push.centre;
    vec3 n = vec3(0.0);
    if (has && OF_POINTS) n = imageLoad(facing, pixel).xyz;
    if (has && OF_POINTS && n == vec3(0.0)) n = mean_of_points(pixel, z, reach);
    if (has && n == vec3(0.0)) n = normal_at(pixel, z, push.radius_px, reach, from_centre, push.px_per_unit, PERSPECTIVE);
    vec2 across = from_centre / push.px_per_unit;
    vec3 ray = vec3(PERSPECTIVE ? across : across / vec2(z), 1.0);
    vec3 l = towards(push.light, ray, z);
    vec3 v = towards(push.eye, ray, z);
    float facing = n.x * l.x + n.y * l.y + n.z * l.z;
    vec3 r = vec3(2.0 * facing) * n - l;
    float mirrored = r.x * v.x + r.y * v.y + r.z * v.z;
    bool oriented = has && n != vec3(0.0) && l != vec3(0.0);
    float diffuse = push.diffuse * mix(1.0, max(facing, 0.0), oriented);
    // A surface that faces away from the light reflects none of it.
    float specular = push.specular * mix(0.0, power(clamp(mirrored, 0.0, 1.0), push.shininess), oriented && facing > 0.0);
    vec3 m = SHADOWED ? imageLoad(shadow_factor, pixel).rgb : vec3(1.0);
    imageStore(shaded, pixel, vec4(c.rgb * (vec3(push.ambient) + m * vec3(diffuse)) + m * vec3(specular * c.a), c.a));
}

void main() {
    EACH_OWN_PIXEL(shade)
}
