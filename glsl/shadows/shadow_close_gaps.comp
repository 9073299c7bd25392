// Depths of the light's picture -> depths with gaps closed that light would fall through, by
// background and hidden filling (Dobrev et al. 2010, sec. 3.2 and 3.3).
//
//   in front: of the eight neighbours, those nearer by more than the layer
//   slope:    the steepest among those in front, between consecutive ones around the texel, and from
//             the texel to those that are not; if three or more are empty, as at a rim, it is unknown
//             and the steepest allowed
//   in front: those nearer by more than the layer of a surface with that slope
//   If five consecutive ones are not (half of the ring: a straight or diagonal silhouette), the texel
//   stays; else it takes the nearest.
//
// A fixed layer for the steepest surface left gaps open in objects less than five times that layer
// in front of others. On a plane the neighbours down its slope are not in front, and the slope is
// known from both sides, so the texel stays. A value filled by an earlier step may be a layer too
// near, so each step asks for one layer more, up to that of the steepest surface.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "pixel.glsl"
#include "tile.glsl"
#include "tile_mask.glsl"
#include "hole_masks.glsl"

layout(local_size_x = 64) in;

#include "light_depth.glsl"

layout(scalar) writeonly buffer Filled { float texel[]; } filled;

void fill(uint texel, vec3 above, vec3 here, vec3 below) {
    float z = here.y;
    bool has = is_depth(z);
    float own = has ? z : 1.0;
    float run = texel_at(own);
    float layer = layer_at(own);
    float most = along_light(layer, push.steepest);
    layer *= push.filled + 1.0;

    float other[8];
    around(above, here, below, other);
    bool known[8];
    bool before[8];
    float front = own - min(layer, most);
    int empty = 0;
    [[unroll]] for (int k = 0; k < 8; ++k) {
        known[k] = is_depth(other[k]);
        before[k] = known[k] && other[k] < front;
        empty += known[k] ? 0 : 1;
    }
    Slope slope = Slope(0.0, 0.0);
    [[unroll]] for (int k = 0; k < 8; ++k) {
        int next = (k + 1) % 8;
        // Consecutive ones around a texel are adjacent.
        float among = before[k] && before[next] ? rise_of(other[k], other[next], run) : 0.0;
        slope.beside = max(slope.beside, among);
        rises(slope, k, own, known[k] && !before[k] ? other[k] : own, run);
    }
    float tangent = empty < 3 ? tangent_of(slope, run) : push.steepest;
    front = own - min(along_light(layer, tangent), most);
    float nearest = uintBitsToFloat(BACKGROUND_BITS);
    uint open = 0u;
    [[unroll]] for (int k = 0; k < 8; ++k) {
        bool closes = known[k] && (!has || other[k] < front);
        nearest = closes ? min(nearest, other[k]) : nearest;
        open |= uint(!closes) << k;
    }
    filled.texel[texel] = any_mask(open) ? z : nearest;
}

void column(uint place) {
    DOWN_COLUMN(place, fill)
}

void main() {
    EACH_OWN_COLUMN(column)
}
