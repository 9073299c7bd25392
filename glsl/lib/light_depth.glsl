// Depths of the light's picture and the layer behind them, shared by the passes over it.
// pixel.glsl, tile.glsl and tile_mask.glsl come before.

layout(constant_id = 0) const bool PERSPECTIVE = false;
layout(constant_id = 1) const bool TEXELS = true;
// True if the depths are those of keys, next to their points (keys.glsl); without a point there is
// none.
layout(constant_id = 2) const bool OF_KEYS = false;

// f32 bits, row by row; as texels, and as words if texel buffers are too small. Software devices
// write buffers several times faster than images, and gather from one row of texels faster than
// from several.
layout(r32ui) readonly uniform uimageBuffer depth;
layout(scalar) readonly buffer DepthWords { uint word[]; } depth_words;

// Keys of the nearest layer.
const bool BEHIND = false;

#include "keys.glsl"

const float FARTHEST = 3.402823466e38;

layout(push_constant, scalar) uniform Push {
    uvec2 size;     // texels
    float texel;    // side of a texel: metres, or a share of the depth with perspective
    float layer;    // across a surface: metres,
    float layer_px; // and texels' sides
    float steepest; // tangent of the steepest angle to the light
    float filled;   // steps of filling so far
    float within;   // only nearer points need limits
    uint margin;    // border [texels] of other pictures, unlit by this one
} push;

float texel_at(float z) {
    return PERSPECTIVE ? z * push.texel : push.texel;
}

float layer_at(float z) {
    return push.layer + push.layer_px * texel_at(z);
}

// Returns the thickness of a layer along the light, layer / <v, n>, by the tangent of the angle
// between them.
float along_light(float layer, float tangent) {
    return layer * sqrt(1.0 + tangent * tangent);
}

// Slope of the surface around a texel: the largest rises to a neighbour at a side, or across a
// corner, sqrt(2) away. They are divided by the distance once at the end, since divisions are the
// most expensive part.
struct Slope {
    float beside;
    float across;
};

const float SQRT_2 = 1.41421356;
const float SQRT_1_2 = 0.70710678;

// Returns 0 for a rise so steep that the two are of two surfaces. A depth may be a whole texel's
// fall too large, so that is only beyond 1 + sqrt(2) times the steepest slope.
float rise_of(float from, float to, float run) {
    float rise = abs(to - from);
    return rise <= 2.41421356 * push.steepest * run ? rise : 0.0;
}

// Adds the rise to a neighbour, by its number.
void rises(inout Slope slope, int neighbour, float from, float to, float run) {
    if (neighbour % 2 == 0) {
        slope.across = max(slope.across, rise_of(from, to, SQRT_2 * run));
    } else {
        slope.beside = max(slope.beside, rise_of(from, to, run));
    }
}

// Returns the tangent of the angle to the light.
float tangent_of(Slope slope, float run) {
    return min(max(slope.beside, slope.across * SQRT_1_2) / run, push.steepest);
}

// Depths are infinite without a point, and 0 outside of the picture.
bool is_depth(float z) {
    return z > 0.0 && z <= FARTHEST;
}

float depth_of(int texel) {
    // No access is out of bounds, even if its result is not used.
    uint inside = uint(clamp(texel, 0, int(push.size.x * push.size.y) - 1));
    uint word = OF_KEYS ? depth_word(inside) : inside;
    uint bits = TEXELS ? imageLoad(depth, int(word)).r : depth_words.word[word];
    return uintBitsToFloat(OF_KEYS ? min(bits, BACKGROUND_BITS) : bits);
}

// Returns three texels of a row around a place. Places outside of the picture read other texels,
// and do not count.
vec3 three(ivec2 at) {
    int texel = at.y * int(push.size.x) + at.x;
    vec3 row = vec3(depth_of(texel - 1), depth_of(texel), depth_of(texel + 1));
    bool inside = at.y >= 0 && at.y < int(push.size.y);
    bvec3 across = bvec3(at.x > 0, at.x < int(push.size.x), at.x + 1 < int(push.size.x));
    return mix(vec3(0.0), row, bvec3(inside && across.x, inside && across.y, inside && across.z));
}

// Returns the ring around a texel, clockwise from the upper left.
void around(vec3 above, vec3 here, vec3 below, out float ring[8]) {
    ring = float[8](above.x, above.y, above.z, here.z, below.z, below.y, below.x, here.x);
}

uvec2 light_tiles() {
    return (push.size + uint(TILE_PX - 1)) / uint(TILE_PX);
}

// Runs `work` for every texel of a tile's column, from top to bottom, with its place in the buffer
// and its surroundings. Each row is loaded once for the three that read it.
#define DOWN_COLUMN(place, work) { \
    ivec2 texel = column_of(LISTED ? listed_number(place, light_tiles().x) : place, light_tiles().x); \
    vec3 above = three(texel - ivec2(0, 1)); \
    vec3 here = three(texel); \
    [[unroll]] for (int row = 0; row < TILE_PX; ++row) { \
        vec3 below = three(texel + ivec2(0, 1)); \
        if (all(lessThan(uvec2(texel), push.size))) work(uint(texel.y) * push.size.x + uint(texel.x), above, here, below); \
        above = here; \
        here = below; \
        texel.y += 1; \
    } \
}

// Does the same for all tiles, or for listed ones.
#define EACH_OWN_COLUMN(work) EACH_OF(LISTED ? listed_tiles() : light_tiles().x * light_tiles().y, work)
