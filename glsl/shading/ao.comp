// Ambient occlusion: depth -> factor of ambient light that remains (horizons on the screen: Bavoil,
// Sainz and Dimitrov 2008).
//
//   sin^2 h = (v.n)^2 / v.v      h: elevation of a sample above the tangent plane
//                                v: vector to it, n: normal
//   hidden  = mean over directions of the largest sin^2 h of its samples
//   left    = 1 - strength * hidden
// If light counts by its cosine, a horizon at h removes exactly sin^2 h of the light from its
// direction. So no trigonometry is needed, and a plane does not occlude itself however steep it is.
// A sample counts less with distance, by 1 - v.v / radius^2, so that objects far in front cast no
// halo. Vectors are in shares of the depth, or in metres without perspective.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "pixel.glsl"
#include "normalize.glsl"
#include "fit_normal.glsl"

layout(local_size_x = 64) in;

layout(r32f) readonly uniform image2D depth;
layout(r32f) readonly uniform image2D shading;
layout(r32f) writeonly uniform image2D occluded_shading;

layout(constant_id = 0) const bool PERSPECTIVE = true;
// True if an effect before has made a factor.
layout(constant_id = 1) const bool HAS_SHADING = false;
// True if the radius is in metres with perspective, instead of a share of the depth.
layout(constant_id = 2) const bool METRES = false;

layout(push_constant, scalar) uniform Push {
    uvec2 size;        // pixels
    vec2 centre;       // principal point [px]
    float px_per_unit; // perspective: focal length in pixels; orthographic: pixels per metre
    float reach;       // depth difference of surfaces: metres, or a share with perspective
    int radius_px;     // radius of the window that a normal is fitted to
    float radius;      // distance beyond which nothing occludes
    float strength;
    float least;       // sin^2 h that counts as roughness
    int directions;
    int steps;         // samples per direction
    vec2 turn;         // cosine and sine of the angle between directions
} push;

#include "surface_normal.glsl"

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, ivec2(push.size)))) return;
    float z = imageLoad(depth, pixel).r;
    float before = HAS_SHADING ? imageLoad(shading, pixel).r : 1.0;
    float hidden = 0.0;
    if (known(z)) {
        vec2 from_centre = vec2(pixel) + 0.5 - push.centre;
        float unit_m = PERSPECTIVE ? z : 1.0;
        vec3 n = normal_at(pixel, z, push.radius_px, push.reach * unit_m, from_centre, push.px_per_unit, PERSPECTIVE);
        float radius = METRES ? push.radius / unit_m : push.radius;
        float step_px = radius * push.px_per_unit / float(push.steps);
        float share = 1.0 / (radius * radius);
        vec2 way = vec2(1.0, 0.0);
        [[dont_unroll]] for (int direction = 1;; ++direction) {
            float highest = 0.0;
            [[dont_unroll]] for (int n_step = 1;; ++n_step) {
                vec2 aside = floor(way * vec2(step_px * (float(n_step) - 0.5)) + 0.5);
                float other = imageLoad(depth, pixel + ivec2(aside)).r;
                float rise = (other - z) / unit_m;
                bool counts = known(other) && abs(rise) < radius && aside != vec2(0.0);
                rise = mix(0.0, rise, counts);
                vec2 lean = PERSPECTIVE ? (from_centre + aside) / push.px_per_unit : vec2(0.0);
                vec3 v = vec3(aside / push.px_per_unit + lean * vec2(rise), rise);
                float above = v.x * n.x + v.y * n.y + v.z * n.z;
                float square = mix(1.0, v.x * v.x + v.y * v.y + v.z * v.z, counts);
                float height = above * above / square - push.least;
                float near = 1.0 - square * share;
                bool hides = counts && above > 0.0 && height > 0.0 && near > 0.0;
                highest = max(highest, mix(0.0, height * near, hides));
                if (n_step == push.steps) break;
            }
            hidden += highest;
            way = vec2(way.x * push.turn.x - way.y * push.turn.y, way.x * push.turn.y + way.y * push.turn.x);
            if (direction == push.directions) break;
        }
    }
    float own = max(0.0, 1.0 - push.strength * (hidden / float(push.directions)));
    imageStore(occluded_shading, pixel, vec4(before * own));
}
