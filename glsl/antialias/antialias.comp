// Anti-aliasing of silhouettes (Dobrev et al. 2010, sec. 3.5; guide: numerics, case 12): blends
// shaded colour with its neighbours where depth jumps, in listed tiles.
//
//   blend       mean over the 3 x 3 with weights 1 2 1, 2 4 2, 1 2 1, of premultiplied linear light
// Pixels beyond the picture's edge repeat those at it.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "pixel.glsl"
#include "tile.glsl"

layout(local_size_x = 64) in;

layout(scalar) readonly buffer Lists { uint word[]; } lists;
layout(r32f) readonly uniform image2D depth;
layout(rgba32f) readonly uniform image2D color;
layout(r32f) readonly uniform image2D shading;
layout(rgba32f) writeonly uniform image2D blended;
// Factor that remains: 1 for blended pixels, whose colour includes it.
layout(r32f) writeonly uniform image2D remaining_shading;

layout(constant_id = 2) const bool HAS_SHADING = false;

layout(push_constant, scalar) uniform Push {
    uvec2 size; // pixels
    uint tiles_across;
    float jump; // as in antialias_tiles.comp
} push;

#include "silhouette.glsl"

// Three adjacent pixels.
struct Row {
    vec4 sum;     // shaded, with weights 1 2 1
    vec4 color;   // of the one in the middle
    float light;
    vec3 depths;
};

Row row_at(ivec2 pixel, ivec2 last) {
    Row row = Row(vec4(0.0), vec4(0.0), 1.0, vec3(0.0));
    [[unroll]] for (int k = 0; k < 3; ++k) {
        ivec2 at = clamp(pixel + ivec2(k - 1, 0), ivec2(0), last);
        vec4 c = imageLoad(color, at);
        float light = HAS_SHADING ? imageLoad(shading, at).r : 1.0;
        row.depths[k] = imageLoad(depth, at).r;
        row.sum += vec4(k == 1 ? 2.0 : 1.0) * vec4(c.rgb * vec3(light), c.a);
        if (k == 1) row.color = c;
        if (k == 1) row.light = light;
    }
    return row;
}

// Works on a column from top to bottom: its pixels share rows.
void work(uint n) {
    ivec2 last = ivec2(push.size) - 1;
    ivec2 pixel = column_of(lists.word[LIST_HEADER + n], push.tiles_across);
    Row above = row_at(pixel - ivec2(0, 1), last);
    Row own = row_at(pixel, last);
    [[dont_unroll]] for (int row = 0;; ++row) {
        Row below = row_at(pixel + ivec2(0, 1), last);
        bool blends = silhouette(float[5](own.depths.y, own.depths.x, own.depths.z, above.depths.y, below.depths.y));
        vec4 mean = (above.sum + vec4(2.0) * own.sum + below.sum) * vec4(0.0625);
        // Pixels beyond the picture are not written.
        imageStore(blended, pixel, mix(own.color, mean, bvec4(blends)));
        if (HAS_SHADING) imageStore(remaining_shading, pixel, vec4(mix(own.light, 1.0, blends)));
        if (row == TILE_PX - 1) break;
        pixel.y += 1;
        above = own;
        own = below;
    }
}

void main() {
    EACH_OF(lists.word[3], work)
}
