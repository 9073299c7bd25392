// Sums and front points -> colours whose luminance is the mean of all points of the front layer
// (Kanzok, Linsen and Rosenthal 2012, sec. 5; guide: papers).
//
//   V'  = sum / count        over the pixel, or its 3 x 3 with Gaussian weights, for neighbours whose
//                            front is at most epsilon from the pixel's
//   rgb = RGB * (V' / V)     HSV with V' in place of V, without hue or branch (guide: numerics,
//                            case 22); grey V' if V = 0
//   or, with three channels, rgb = sums / count
// All in the non-linear values of points, which are looked up in the table of linear colours with
// linear interpolation, and multiplied by the point's opacity, which is alpha.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_buffer_reference_uvec2 : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "drawn_node.glsl"
#include "tile.glsl"
#include "tile_mask.glsl"

layout(local_size_x = 64) in;

// Two words per sum, as texels; and as words if texel buffers are too small.
layout(r32ui) readonly uniform uimageBuffer sums;
layout(scalar) readonly buffer SumWords { uvec2 sum[]; } sum_words;
// 256 colours of four f32.
layout(rgba32ui) readonly uniform uimageBuffer table;
// The 256 values of every station at one exposure.
layout(r32ui) readonly uniform uimageBuffer levels;
// Addresses of the pages with each node's attribute and kinds, two words each.
layout(scalar) readonly buffer Shown { uvec2 page[]; } shown;
layout(scalar) readonly buffer Kinds { uvec2 page[]; } kinds;
// Factors of opacity (lib/point_kind.glsl).
layout(scalar) readonly buffer Opacities { float factor[]; } opacities;
layout(r32f) readonly uniform image2D front;
layout(r32ui) readonly uniform uimage2D index;
// True if each tile of the whole picture shows several stations, row by row.
layout(r32ui) readonly uniform uimageBuffer several;
layout(rgba32f) writeonly uniform image2D color;

layout(constant_id = 0) const uint CHANNELS = 1u;
// Radius of the averaged neighbourhood [px]: 0, or 1 for 3 x 3.
layout(constant_id = 2) const uint AROUND = 0u;
layout(constant_id = 3) const bool TEXELS = true;
// See resolve.comp.
layout(constant_id = 4) const bool TRANSPARENT = false;
layout(constant_id = 5) const bool BY_KIND = false;
// True if some tiles show only one station.
layout(constant_id = 6) const bool PARTLY = false;
// See resolve.comp.
layout(constant_id = 7) const uint MODE = 0u;

layout(push_constant, scalar) uniform Push {
    uint width;    // pixels
    uvec2 rows;    // first row to correct, and end
    uvec2 summed;  // rows with sums, likewise
    float epsilon;
    float lo;      // attribute words at the ends of the ramp
    float scale;   // 255 / (hi - lo)
    ivec2 corner;  // position in the whole picture [px]
    uint tiles_across;
} push;

const uint NO_POINT = 0xFFFFFFFFu;

#include "point_color.glsl"
#include "luminance.glsl"
#include "color_lookup.glsl"

// Equal to that in station_overlap.rs.
const uint OVERLAP_PX = 64u;

uvec2 sum_at(uint i) {
    return TEXELS ? uvec2(imageLoad(sums, int(2u * i)).r, imageLoad(sums, int(2u * i + 1u)).r) : sum_words.sum[i];
}

// Sums of a few pixels, in halves that a float holds exactly.
struct Total {
    uvec2 sum;   // * 2^18, * 1
    uvec2 count; // * 2^14, * 1
};

void add(inout Total total, uvec2 sum, uint weight) {
    total.sum += weight * uvec2(sum.x >> 18 | (sum.y & 15u) << 14, sum.x & 0x3FFFFu);
    total.count += weight * uvec2(sum.y >> 18, (sum.y >> 4) & 0x3FFFu);
}

// Returns sum / count: the nearest integer by floats, and the remainder from the integers
// themselves, so that a mean of equal values is exactly that value.
float mean(Total total) {
    vec2 sum = vec2(ivec2(total.sum));
    vec2 count = vec2(ivec2(total.count));
    float points = count.x * 16384.0 + count.y;
    int nearest = int((sum.x * 262144.0 + sum.y) / points + 0.5);
    ivec2 left = ivec2(total.sum) * ivec2(16, 1) - nearest * ivec2(total.count);
    return clamp(float(nearest) + (float(left.x) * 16384.0 + float(left.y)) / points, 0.0, 255.0);
}

float linear(float value, int channel) {
    int entry = min(int(value), 254);
    float below = uintBitsToFloat(imageLoad(table, entry)[channel]);
    float above = uintBitsToFloat(imageLoad(table, entry + 1)[channel]);
    return below + (above - below) * (value - float(entry));
}

void correct(ivec2 pixel) {
    // Listed pixels are those of the whole picture.
    if (!LISTED) pixel.y += int(push.rows.x);
    if (pixel.x >= int(push.width) || pixel.y < int(push.rows.x) || pixel.y >= int(push.rows.y)) return;
    uint id = imageLoad(index, pixel).r;
    if (id == NO_POINT) {
        imageStore(color, pixel, vec4(0.0));
        return;
    }
    uint word = shown_word(id);
    float opacity = own_opacity(id);
    if (PARTLY) {
        uvec2 tile = uvec2(pixel + push.corner) / OVERLAP_PX;
        if (imageLoad(several, int(tile.y * push.tiles_across + tile.x)).r == 0u) {
            imageStore(color, pixel, painted(word, push.lo, push.scale) * vec4(opacity));
            return;
        }
    }
    float z = imageLoad(front, pixel).r;
    Total total[3] = Total[3](Total(uvec2(0u), uvec2(0u)), Total(uvec2(0u), uvec2(0u)), Total(uvec2(0u), uvec2(0u)));
    [[unroll]] for (int dy = -int(AROUND); dy <= int(AROUND); ++dy) {
        [[unroll]] for (int dx = -int(AROUND); dx <= int(AROUND); ++dx) {
            ivec2 at = pixel + ivec2(dx, dy);
            bool inside = at.x >= 0 && at.x < int(push.width) && at.y >= int(push.summed.x) && at.y < int(push.summed.y);
            at = inside ? at : pixel;
            // Empty pixels are infinitely far.
            bool same = inside && abs(imageLoad(front, at).r - z) <= push.epsilon;
            uint weight = same ? uint((2 - abs(dx)) * (2 - abs(dy))) : 0u;
            uint first = CHANNELS * (uint(at.y - int(push.summed.x)) * push.width + uint(at.x));
            for (uint c = 0u; c < CHANNELS; ++c) add(total[c], sum_at(first + c), weight);
        }
    }
    ivec3 values = ivec3(levels_of(word, MODE == RAMP, push.lo, push.scale));
    int value = max(max(values.r, values.g), values.b);
    float ratio = mean(total[0]) / float(max(value, 1));
    vec3 corrected = value == 0 ? vec3(mean(total[0])) : min(vec3(values) * vec3(ratio), vec3(255.0));
    if (CHANNELS == 3u) corrected = vec3(mean(total[0]), mean(total[1]), mean(total[2]));
    imageStore(color, pixel, vec4(vec3(linear(corrected.r, 0), linear(corrected.g, 1), linear(corrected.b, 2)) * vec3(opacity), opacity));
}

void main() {
    EACH_OWN_PIXEL(correct)
}
