// Sums -> colours whose luminance is the mean of all points of the front layer (Kanzok, Linsen and Rosenthal 2012, sec. 5; papers/README.md).
//
//   V'  = sum / count          over the pixel, or over its 3 x 3 with the weights of a Gaussian, neighbours whose front is at most epsilon from the pixel's
//   rgb = RGB * (V' / V)       which is HSV with V' in place of V: no hue, no branch (HARD_CASES 22); grey V' where V = 0
//   or, with three channels, rgb = sums / count
// All in the values that points have, which are not linear; they are looked up in the table of linear colours, between whose entries the way is straight. A pixel without a count stays as it is.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

layout(local_size_x = 64) in;

// Two words a sum; as texels, and for devices whose texel buffers are too small as a storage buffer.
layout(r32ui) readonly uniform uimageBuffer sums;
layout(scalar) readonly buffer SumWords { uvec2 sum[]; } sum_words;
// 256 colours, four words of f32 bits each.
layout(rgba32ui) readonly uniform uimageBuffer table;
layout(r32f) readonly uniform image2D front;
// Values of the front point, beside its opacity -> linear, multiplied by it.
layout(rgba32f) uniform image2D color;

layout(constant_id = 0) const uint CHANNELS = 1u;
// Pixels around one that count: 0, or 1 for its 3 x 3.
layout(constant_id = 2) const uint AROUND = 0u;
layout(constant_id = 3) const bool TEXELS = true;

layout(push_constant, scalar) uniform Push {
    uint width;    // pixels
    uvec2 rows;    // of the picture: the first to correct, and the one after the last
    uvec2 summed;  // rows that there are sums of, in the same way
    float epsilon;
} push;

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

// sum / count: the nearest whole number by floats, and what is left of that from the whole numbers themselves, so that a mean of equal values is that value, however many they are.
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

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.x, gl_GlobalInvocationID.y + push.rows.x);
    if (pixel.x >= int(push.width) || pixel.y >= int(push.rows.y)) return;
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
    // Without a point, or of a layer that is not drawn here.
    if (total[0].count == uvec2(0u)) return;
    vec4 own = imageLoad(color, pixel);
    ivec3 values = ivec3(own.rgb * vec3(255.0) + 0.5);
    int value = max(max(values.r, values.g), values.b);
    float ratio = mean(total[0]) / float(max(value, 1));
    vec3 corrected = value == 0 ? vec3(mean(total[0])) : min(vec3(values) * vec3(ratio), vec3(255.0));
    if (CHANNELS == 3u) corrected = vec3(mean(total[0]), mean(total[1]), mean(total[2]));
    imageStore(color, pixel, vec4(vec3(linear(corrected.r, 0), linear(corrected.g, 1), linear(corrected.b, 2)) * vec3(own.a), own.a));
}
