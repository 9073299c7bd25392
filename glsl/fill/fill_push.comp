// A level of the pyramid and the filled next coarser one -> this level filled (Grossman and Dally
// 1998, sec. 7; Marroquim, Kraus and Cavalcanti 2008, sec. 4).
//
//   cell with a value:  the value, carried from its place to the cell's middle by the coarser slope
//   cell without:       belongs to the surface whose known place is nearest: among the eight cells
//                       around, else among the places that the four coarser cells around have
//                       found. It takes the mean of those coarser cells that are of it, weighted
//                       bilinearly; without any, the value of that place.
//   cell of points that its coarser cell has alone: takes the colour of a cell without a value, so
//                       that sparse points do not stand out of their surroundings as dots.
//   lone point          behind all four coarser cells around: counts as hidden. It would show as a
//                       patch of a surface behind, as wide as points are apart.
//
// Every cell passes on the nearest place it has found. So borders between surfaces lie halfway
// between points, not along coarser cells.
//
// Pixels of the picture keep their depths. Background is filled in notches of contours. With
// perspective, means are of inverse depths, as ratios to one of them.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "pixel.glsl"

layout(local_size_x = 64) in;

layout(r32f) readonly uniform image2D coarse_depth;
layout(rgba32f) readonly uniform image2D coarse_color;
layout(rgba32f) readonly uniform image2D coarse_places;
// Depths of the picture, and values of other levels (fill_pull.comp).
layout(r32f) readonly uniform image2D depth;
layout(rgba32f) readonly uniform image2D places;
layout(rgba32f) readonly uniform image2D color;
layout(r32f) writeonly uniform image2D filled_depth;
layout(rgba32f) writeonly uniform image2D filled_color;
// Where the nearest known place of each cell is, its own or another's, as in `places`.
layout(rgba32f) writeonly uniform image2D filled_places;
// How far the value of a cell lies from the mean that it would take without: metres, or a share of
// inverse depth with perspective. None for a cell without a value, and the negative of none where
// there is no mean.
layout(r32f) writeonly uniform image2D missed;

layout(constant_id = 0) const bool PERSPECTIVE = true;
// True if there is no coarser level.
layout(constant_id = 1) const bool COARSEST = false;
layout(constant_id = 2) const bool PICTURE = false;
// True if colours are labels, which are never mixed.
layout(constant_id = 3) const bool LABELS = false;

layout(push_constant, scalar) uniform Push {
    uvec2 coarse_size;
    uvec2 size;
    float tolerance; // depth difference: metres, or a share of the depth if relative
    uint relative;
    uint flood; // 1: background is to be filled, too
    uint surrounded; // or with this many filled neighbours
} push;

#define NONE uintBitsToFloat(BACKGROUND_BITS)

// Larger than the square of any distance of adjacent cells.
const float FAR = 1e9;

// Returns a cell of this level before filling: depth, and place from the cell's middle [cells].
vec4 known(ivec2 cell) {
    return PICTURE ? vec4(imageLoad(depth, clamp(cell, ivec2(0), ivec2(push.size) - 1)).r, 0.0, 0.0, 1.0) : imageLoad(places, clamp(cell, ivec2(0), ivec2(push.size) - 1));
}

// Returns none outside.
float coarse_at(ivec2 at) {
    ivec2 size = ivec2(push.coarse_size);
    bool inside = all(greaterThanEqual(at, ivec2(0))) && all(lessThan(at, size));
    float z = imageLoad(coarse_depth, clamp(at, ivec2(0), size - 1)).r;
    return inside ? z : NONE;
}

float tolerance_at(float z) {
    return push.relative == 1u ? push.tolerance * z : push.tolerance;
}

// Returns the rise of the depth to an adjacent coarse cell, or the fall to the one on the other
// side, on one surface: metres, or shares of inverse depth with perspective. Of both the harmonic
// mean, and none if they differ in sign, so that values carried beyond a crease do not overshoot
// (van Leer 1974).
float slope(float z, float before, float after) {
    bool has_before = abs(before - z) <= tolerance_at(z);
    bool has_after = abs(after - z) <= tolerance_at(z);
    float fall = has_before ? (PERSPECTIVE ? 1.0 - z / before : z - before) : 0.0;
    float rise = has_after ? (PERSPECTIVE ? z / after - 1.0 : after - z) : 0.0;
    float both = fall + rise;
    float limited = fall * rise > 0.0 ? 2.0 * fall * (rise / both) : 0.0;
    return has_before && has_after ? limited : both;
}

// Returns a value carried to the middle of its cell.
float in_middle(vec4 place, ivec2 parent) {
    float z = coarse_at(parent);
    vec2 slopes = vec2(slope(z, coarse_at(parent - ivec2(1, 0)), coarse_at(parent + ivec2(1, 0))), slope(z, coarse_at(parent - ivec2(0, 1)), coarse_at(parent + ivec2(0, 1))));
    float away = 0.5 * (slopes.x * place.y + slopes.y * place.z);
    // Relative to the place's own inverse depth.
    float ratio = 1.0 - away * (place.x / z);
    float carried = PERSPECTIVE ? place.x / (ratio > 0.5 && ratio < 2.0 ? ratio : 1.0) : place.x - away;
    return z <= 3.402823466e38 ? carried : place.x;
}

void main() {
    ivec2 cell = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(cell, ivec2(push.size)))) return;
    vec4 own_color = imageLoad(color, cell);
    vec4 place = known(cell);
    uint own = floatBitsToUint(place.x);
    ivec2 parent = cell / 2;
    bool has_own = has_depth(own) && place.x > 0.0;
    if (COARSEST) {
        imageStore(filled_depth, cell, vec4(place.x));
        imageStore(filled_color, cell, own_color);
        imageStore(filled_places, cell, place);
        imageStore(missed, cell, vec4(has_own ? -NONE : NONE));
        return;
    }
    float z = has_own && !PICTURE ? in_middle(place, parent) : place.x;
    // The nearest of the cells around that have a value, and how many have one or will have.
    float like = has_own ? place.x : NONE;
    float nearest = has_own ? 0.0 : FAR;
    ivec2 nearest_at = cell;
    uint solid = 0u;
    if (!has_own) {
        [[unroll]] for (int k = 0; k < 9; ++k) {
            if (k == 4) continue;
            ivec2 offset = ivec2(k % 3, k / 3) - 1;
            ivec2 at = cell + offset;
            bool inside = all(greaterThanEqual(at, ivec2(0))) && all(lessThan(at, ivec2(push.size)));
            vec4 found = known(at);
            vec2 to = vec2(offset) + found.yz;
            float square = to.x * to.x + to.y * to.y;
            bool has = inside && found.x > 0.0 && has_depth(floatBitsToUint(found.x));
            bool nearer = has && square < nearest;
            solid += uint(has || (inside && floatBitsToUint(found.x) == UNKNOWN_BITS));
            nearest = nearer ? square : nearest;
            like = nearer ? found.x : like;
            place = nearer ? vec4(found.x, to, found.w) : place;
            nearest_at = nearer ? at : nearest_at;
        }
    }
    vec4 parent_place = imageLoad(coarse_places, parent);
    bool lone = has_own && !LABELS && parent_place.w == place.w && abs(parent_place.x - place.x) <= tolerance_at(place.x);
    bool filling = !has_own && (!PICTURE || own == UNKNOWN_BITS || push.flood == 1u || solid >= push.surrounded);
    float missed_by = has_own ? -NONE : NONE;
    if (filling || has_own || !PICTURE) {
        ivec2 toward = 2 * (cell % 2) - 1;
        float from[4];
        vec4 c[4];
        // The nearest place that coarser cells know, and their farthest surface.
        float coarse_nearest = FAR;
        int nearest_of = 0;
        vec4 nearest_place = vec4(NONE, vec3(0.0));
        float farthest = -1.0;
        [[unroll]] for (int k = 0; k < 4; ++k) {
            ivec2 at = parent + toward * ivec2(k % 2, k / 2);
            from[k] = coarse_at(at);
            c[k] = imageLoad(coarse_color, clamp(at, ivec2(0), ivec2(push.coarse_size) - 1));
            vec3 found = imageLoad(coarse_places, clamp(at, ivec2(0), ivec2(push.coarse_size) - 1)).xyz;
            vec2 to = 2.0 * (vec2(at) + 0.5 + found.yz) - (vec2(cell) + 0.5);
            float square = to.x * to.x + to.y * to.y;
            bool has = has_depth(floatBitsToUint(from[k]));
            bool nearer = has && square < coarse_nearest;
            coarse_nearest = nearer ? square : coarse_nearest;
            nearest_place = nearer ? vec4(from[k], to, 0.0) : nearest_place;
            nearest_of = nearer ? k : nearest_of;
            farthest = has ? max(farthest, from[k]) : farthest;
        }
        // A lone point behind all around it counts as hidden.
        bool hidden = !PICTURE && place.w == 1.0 && farthest > 0.0 && like - tolerance_at(like) > farthest;
        filling = filling || hidden;
        vec4 like_color = nearest < FAR ? imageLoad(color, nearest_at) : vec4(0.0);
        if (nearest == FAR || hidden) {
            like = nearest_place.x;
            place = nearest_place;
            like_color = nearest_of == 0 ? c[0] : nearest_of == 1 ? c[1] : nearest_of == 2 ? c[2] : c[3];
        }
        bool reached = has_depth(floatBitsToUint(like));
        float weights = 0.0;
        float sum = 0.0;
        vec4 colors = vec4(0.0);
        [[unroll]] for (int k = 0; k < 4; ++k) {
            bool has = reached && has_depth(floatBitsToUint(from[k]));
            float difference = has ? from[k] - like : 0.0;
            float weight = has && abs(difference) <= tolerance_at(like) ? (k == 0 ? 9.0 : k == 3 ? 1.0 : 3.0) : 0.0;
            weights += weight;
            sum += weight * (PERSPECTIVE ? like / (like + difference) : difference);
            colors += weight * c[k];
        }
        bool valued = weights > 0.0;
        float many = valued ? weights : 1.0;
        float mean = PERSPECTIVE ? like / (valued ? sum / many : 1.0) : like + sum / many;
        vec4 filled = LABELS || !valued ? like_color : colors / many;
        bool compared = has_own && !hidden && valued;
        missed_by = compared ? (PERSPECTIVE ? mean / z - 1.0 : z - mean) : hidden ? NONE : missed_by;
        z = !filling ? z : !reached ? NONE : valued ? mean : like;
        own_color = filling || (lone && valued) ? filled : own_color;
    }
    imageStore(filled_depth, cell, vec4(z));
    imageStore(filled_color, cell, own_color);
    imageStore(missed, cell, vec4(missed_by));
    if (!PICTURE) imageStore(filled_places, cell, place);
}
