// A stroke from a point's two words (src/index/attributes/strokes.rs). Declares no bindings.

#include "stroke_constants.glsl"
#include "exact_dot.glsl"
#include "octahedral.glsl"
#include "stroke_tangent.glsl"

// A node by its number: address of its first page, number of position planes, and for drawn ones
// the place of its first point among all strokes.
struct Home {
    uvec2 page;
    uint planes;
    uint first_place;
};

// A square in the world around its point: unit vectors, and half of its side along each [m].
struct Square {
    vec3 normal;
    vec3 tangent;
    vec3 bitangent;
    vec2 half_side;
};

const uint SMALL_CLUSTER = 1u << 7;
// Rotations of half a circle come after those of brushes.
const uint HALF_CIRCLE = 20u;

uint turn_of(uint brush) {
    return HALF_CIRCLE + ((brush >> 8) & 255u);
}

// Returns the square seen along `sight`. The normal is turned towards the viewer, so a closed
// surface has its outward ones: where they flip nothing is visible. A point without one faces the
// viewer. `turn` is the angle from the tangent to the direction in which neighbours spread most.
Square square_of(Canvas canvas, uint facing, uint brush, vec3 sight, float px_per_m, vec2 turn) {
    bool known = (facing & UNKNOWN_NORMAL) != UNKNOWN_NORMAL;
    vec3 stored = normal_of(known ? facing : 0u);
    vec3 normal = known ? stored : -sight / vec3(sqrt(dot_of(sight, sight)));
    normal = dot_of(normal, sight) > 0.0 ? -normal : normal;
    // In the cloud's own axes, so that strokes turn with a cloud that is rotated in its file.
    vec3 own = vec3(dot_of(canvas.axis_x, normal), dot_of(canvas.axis_y, normal), dot_of(canvas.axis_z, normal));
    vec3 of_own = tangent_of(canvas.tangents, own);
    vec3 tangent = canvas.axis_x * vec3(of_own.x) + canvas.axis_y * vec3(of_own.y) + canvas.axis_z * vec3(of_own.z);
    if (canvas.tangents == COVARIANCE && known) tangent = turned(stored, turn);
    float radius_m = uintBitsToFloat(brush & 0xFFFF0000u);
    float half_side = clamp(canvas.scale * radius_m * px_per_m, canvas.least_px, canvas.largest_px) / px_per_m;
    float longer = 1.0 + canvas.lengthen * min(float(brush & 31u) / 8.0, 1.0);
    return Square(normal, tangent, cross_of(normal, tangent), vec2(half_side * longer, half_side));
}

// World to view; x and y as pixels at a depth of one.
vec3 to_view(Canvas canvas, vec3 v) {
    return vec3(dot_of(canvas.right, v) * canvas.focal, dot_of(canvas.down, v) * canvas.focal, dot_of(canvas.forward, v));
}

// Returns the view direction of a pixel at this offset from the centre.
vec3 sight_of(Canvas canvas, vec2 off) {
    return canvas.right * vec3(off.x / canvas.focal) + canvas.down * vec3(off.y / canvas.focal) + canvas.forward;
}
