// Strokes of a tile -> its pixels (dos Anjos et al. 2018, sec. 3.3.2).
//
//   A pass takes a limited number of strokes of each tile; as many passes as the longest list needs,
//   since lavapipe ends all loops of an invocation after 65,535 rounds.
//   A workgroup takes a tile of 8 x 8 pixels, a lane a pixel, which tests all strokes of the tile.
//     A stroke is a square in the plane of its point's normal; a pixel's ray meets it at (u, v).
//     Its brush gives the coverage there (stroke_brush).
//
//   Ends of strokes stand out from crests and claws: a pixel is painted only on a surface
//   (stroke_surface).
//
//   fragments  colour, coverage times opacity, and depth of everything that covers a pixel at all; or
//              their number unless KEPT
//   keys       depth and point of the nearest that covers enough, whatever its opacity, as project64
//              leaves them, so that resolve and all effects follow as for points
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require

#include "stroke_fragment.glsl"
#include "tile.glsl"
#include "stroke_constants.glsl"

layout(local_size_x = 64) in;

layout(constant_id = 0) const bool PERSPECTIVE = true;
// True if fragments are stored, not only counted.
layout(constant_id = 1) const bool KEPT = false;
layout(constant_id = 2) const bool TEXELS = true;
// True if fragments are ordered by the depths of their strokes' points, not by their own.
layout(constant_id = 3) const bool BY_STROKE = false;
// True if fragments behind one that covers its pixel completely are left out.
layout(constant_id = 4) const bool BEFORE_HIDERS = false;

layout(scalar) readonly buffer Canvases { Canvas canvas[]; } canvases;
// First tile and end, and two more words; then the first stroke of every tile, and the end of all.
layout(scalar) readonly buffer Part { uint tile[]; } part;
// Strokes from stroke_bins, as texels; and as words if texel buffers are too small. Brushes, too.
layout(rgba32ui) readonly uniform uimageBuffer strokes;
layout(scalar) readonly buffer StrokeWords { uvec4 texel[]; } stroke_words;
layout(r32ui) readonly uniform uimageBuffer brushes;
layout(scalar) readonly buffer BrushWords { uint word[]; } brush_words;
// First fragment of every pixel, tile by tile.
layout(scalar) readonly buffer Starts { uint word[]; } starts;
// Not 0 for pixels on a surface, row by row.
layout(scalar) readonly buffer Surface { uint word[]; } surface;
layout(scalar) buffer Keys { uvec2 key[]; } keys;
// Number of fragments of every pixel so far, tile by tile, and whether its key is of a stroke that
// hides what is behind.
layout(scalar) buffer Counts { uint word[]; } counts;
layout(scalar) writeonly buffer Fragments { uvec2 fragment[]; } fragments;
// Depth of the nearest fragment that covers each pixel completely, tile by tile: found while all
// are counted.
layout(scalar) buffer Hiders { uint depth[]; } hiders;

layout(push_constant, scalar) uniform Push {
    uint before; // strokes of each tile before this pass
} push;

const uint STROKES_AT_ONCE = 8192u;
const uint HIDING = 1u << 31;
const uint PARTS = 4u;
const uint NO_POINT = 0xFFFFFFFFu;

uvec4 texel(uint i) {
    return TEXELS ? imageLoad(strokes, int(i)) : stroke_words.texel[i];
}

#include "brush.glsl"

bool nearer(uvec2 key, uvec2 than) {
    return key.y < than.y || key.y == than.y && key.x < than.x;
}

void main() {
    Canvas canvas = canvases.canvas[0];
    uint place = gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x;
    uint tile = part.tile[0] + place;
    if (tile >= part.tile[1]) return;
    uint lane = gl_LocalInvocationID.x;
    uvec2 pixel = uvec2(in_rows(tile, canvas.tiles.x)) * 8u + uvec2(lane % 8u, lane / 8u);
    bool inside = pixel.x < canvas.size.x && pixel.y < canvas.size.y;
    uint at_key = inside ? pixel.y * canvas.size.x + pixel.x : 0u;
    bool painted = inside && surface.word[at_key] != 0u;
    vec2 at = canvas.corner + vec2(pixel) + vec2(0.5);
    float hides = canvas.hides;
    uint stroke = part.tile[PARTS + place] + push.before;
    uint end = min(part.tile[PARTS + place + 1u], stroke + STROKES_AT_ONCE);
    if (stroke >= end) return;
    uint start = KEPT ? starts.word[place * 64u + lane] : 0u;
    uint room = KEPT ? starts.word[place * 64u + lane + 1u] - start : NO_POINT;
    uint count = counts.word[place * 64u + lane];
    uvec2 key_before = KEPT ? keys.key[at_key] : uvec2(NO_POINT);
    uvec2 front = count >= HIDING ? key_before : uvec2(NO_POINT);
    uvec2 veil = count >= HIDING ? uvec2(NO_POINT) : key_before;
    count &= ~HIDING;
    uint hider = hiders.depth[place * 64u + lane];

    for (; stroke < end; ++stroke) {
        vec4 centre_turning = uintBitsToFloat(texel(3u * stroke));
        vec4 axes = uintBitsToFloat(texel(3u * stroke + 1u));
        Met met = meet(at, centre_turning, axes, canvas.reach);
        // A loop, because software devices execute branches that no lane takes.
        for (bool todo = painted && met.is_on; todo; todo = false) {
            uvec4 rest = texel(3u * stroke + 2u);
            float z = depth_of(met, uintBitsToFloat(rest.x));
            uint brush = rest.z >> 24;
            float alpha = coverage(met.uv, brush);
            vec3 roots = roots_of(rest.z);
            // Detail in two layers: a smaller stroke across the first, slightly lighter or darker.
            for (bool second = rest.w >> 31 != 0u; second; second = false) {
                float upper = second_coverage(met.uv, brush) * canvas.detail;
                float shade = (brush & 1u) == 0u ? 1.08 : 0.92;
                roots = roots * vec3(1.0 - upper) + min(roots * vec3(shade), vec3(1.0)) * vec3(upper);
                alpha = max(alpha, upper);
            }
            uvec2 key = uvec2(rest.y, floatBitsToUint(z));
            bool seen = z > 0.0;
            front = seen && alpha >= hides && nearer(key, front) ? key : front;
            uint covers = uint(alpha * abs(uintBitsToFloat(rest.w)) * 255.0 + 0.5);
            seen = seen && covers > 0u;
            veil = seen && nearer(key, veil) ? key : veil;
            // Within 16 steps of f32, as on a plane seen from above, brushes decide: a stroke is
            // above another everywhere.
            uint order = (BY_STROKE ? rest.x : key.y) & ~15u | brush >> 4;
            if (!BEFORE_HIDERS) hider = seen && covers == 255u ? min(hider, order) : hider;
            seen = seen && (!BEFORE_HIDERS || order <= hider);
            if (KEPT && seen && count < room) fragments.fragment[start + count] = uvec2(pack_roots(roots) | (255u - covers) << 24, order);
            count += seen ? 1u : 0u;
        }
    }
    if (!KEPT && !BEFORE_HIDERS) hiders.depth[place * 64u + lane] = hider;
    counts.word[place * 64u + lane] = count | (KEPT && front.x != NO_POINT ? HIDING : 0u);
    // Without a stroke that hides, the nearest of all shows.
    uvec2 key = front.x == NO_POINT ? veil : front;
    if (KEPT && painted) keys.key[at_key] = key;
}
