// Depths of the light's picture -> depth that light reaches in each texel: depth + layer / <v, n>
// (Dobrev et al. 2010, sec. 6).
//
// Points have no normals; the slope is the steepest one to the eight neighbours on the same
// surface. Within a texel a plane falls by at most the difference to the neighbour across the lower
// corner, sqrt(2) texels away: with a layer of sqrt(2) texels no plane shades itself (guide:
// numerics, case 13). The flatter side of each axis would not do: if two neighbours have equal
// depths by chance, steep planes shade themselves. So at an edge the drop to what lies behind
// counts as slope, and the texel's own shadow begins as far back as behind the steepest surface.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "pixel.glsl"
#include "tile.glsl"
#include "tile_mask.glsl"

layout(local_size_x = 64) in;

#include "light_depth.glsl"

layout(scalar) writeonly buffer Limit { float texel[]; } limit;

void reach(uint texel, vec3 above, vec3 here, vec3 below) {
    float z = here.y;
    bool has = is_depth(z);
    float own = has ? z : 1.0;
    float run = texel_at(own);
    float other[8];
    around(above, here, below, other);
    Slope slope = Slope(0.0, 0.0);
    [[unroll]] for (int k = 0; k < 8; ++k) rises(slope, k, own, is_depth(other[k]) ? other[k] : own, run);
    float reach = own + along_light(layer_at(own), tangent_of(slope, run));
    // If the layer is below an ulp of the depth, the limit still includes the depth itself (guide:
    // numerics, case 15).
    float beyond = max(reach, uintBitsToFloat(floatBitsToUint(own) + 1u));
    beyond = has ? beyond : z;
    if (push.margin > 0u) {
        uvec2 at = uvec2(texel % push.size.x, texel / push.size.x);
        bool is_others = any(lessThan(at, uvec2(push.margin))) || any(greaterThanEqual(at + push.margin, push.size));
        beyond = is_others ? 0.0 : beyond;
    }
    limit.texel[texel] = beyond;
}

void column(uint place) {
    DOWN_COLUMN(place, reach)
}

void main() {
    EACH_OWN_COLUMN(column)
}
