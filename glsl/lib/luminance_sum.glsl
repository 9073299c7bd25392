// Four neighbours -> sums of their pixels. The includer has `front`, `levels`, `shallow`, a buffer
// `sums`, and `add_to`, which adds a channel's value and count to a pixel's; point_loop.glsl comes
// after.

#include "luminance.glsl"
#include "pixel_index.glsl"

#define IS_TO_BE_WALKED(at) (shallow.chunk[at] != 0u)
#define WALKED(at)

void four(uint pixel[4], float depth[4], uvec4 words) {
    uint width = uint(push.size.x);
    uint count[4];
    uvec3 value[4];
    for (uint k = 0u; k < 4u; ++k) {
        uint at = pixel[k] == NO_PIXEL ? 0u : pixel[k];
        float nearest = imageLoad(front, in_rows(at, width) + ivec2(0, push.top)).r;
        // Points in front of the nearest one are of a layer that has been peeled off.
        pixel[k] = depth[k] >= nearest && depth[k] <= nearest + push.epsilon ? pixel[k] : NO_PIXEL;
        uvec3 bytes = shown_bytes(words[k], RAMP, push.lo, push.scale);
        count[k] = 1u;
        // More light is a greater value, so the largest channel stays the largest.
        uvec3 values = CHANNELS == 1u ? uvec3(value_of(bytes)) : bytes;
        value[k].r = level_of(values.r, words[k]);
        if (CHANNELS == 3u) value[k].gb = uvec2(level_of(values.g, words[k]), level_of(values.b, words[k]));
    }
    // Points are in Morton order: many neighbours are in the same pixel and share one atomic.
    for (uint k = 1u; k < 4u; ++k) {
        bool together = pixel[k] == pixel[k - 1u];
        count[k] += together ? count[k - 1u] : 0u;
        value[k] += together ? value[k - 1u] : uvec3(0u);
        pixel[k - 1u] = together ? NO_PIXEL : pixel[k - 1u];
    }
    // The lane with the most pixels decides the number of rounds: atomics cost a software device
    // their time for every lane.
    for (;;) {
        uint at = NO_PIXEL, points = 0u;
        uvec3 sum = uvec3(0u);
        for (uint k = 0u; k < 4u; ++k) {
            bool next = at == NO_PIXEL && pixel[k] != NO_PIXEL;
            at = next ? pixel[k] : at;
            points = next ? count[k] : points;
            sum = next ? value[k] : sum;
            pixel[k] = next ? NO_PIXEL : pixel[k];
        }
        if (at == NO_PIXEL) break;
        add_to(CHANNELS * at, sum.r, points);
        if (CHANNELS == 3u) {
            add_to(3u * at + 1u, sum.g, points);
            add_to(3u * at + 2u, sum.b, points);
        }
    }
}
