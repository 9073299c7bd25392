// Four neighbours -> the keys of their pixels. The includer has BEHIND, `front_depth`, and `meet`,
// which brings one point to its pixel; point_loop.glsl comes after.
//
//   for a layer behind others, skip points that are not behind them, and chunks that had none left
//   one layer before
//   of neighbours in the same pixel keep the nearest; points are in Morton order: many are
//   bring it to the pixel unless a nearer one is known there: a stale answer only costs an atomic,
//   since keys only fall
//
// Each step was kept because it was faster on lavapipe when it was added to the ones before: words
// in fours, the early read, the merging, nodes drawn from front to back; together they doubled the
// rate. Most of the rest is atomics. `bench project` measures the whole.

// The depths that points must be behind only grow from layer to layer, so a chunk without points
// behind them never has one again. Layers count from 1; every chunk is walked for the first.
#define IS_TO_BE_WALKED(at) (!BEHIND || alive.layer[at] + 1u >= push.layer)

bool any_behind = false;

// A second walk needs the chunks with points at most epsilon behind the front (luminance.rs). While
// the front still comes nearer, points that are behind it stay so.
layout(constant_id = 8) const bool SHALLOW = false;

bool any_shallow = false;

void walked(uint at) {
    if (BEHIND && any_behind) alive.layer[at] = push.layer;
    if (SHALLOW && any_shallow) shallow.chunk[at] = 1u;
}
#define WALKED(at) walked(at)

void four(uint pixel[4], float depth[4], uint first) {
    uint seen[4];
    for (uint k = 0u; k < 4u; ++k) {
        uint least = 0u;
        // A point without a pixel may read any, such as pixel 0.
        seen[k] = front_depth(pixel[k] == NO_PIXEL ? 0u : pixel[k], least);
        if (!BEHIND) continue;
        pixel[k] = floatBitsToUint(depth[k]) > least ? pixel[k] : NO_PIXEL;
        any_behind = any_behind || pixel[k] != NO_PIXEL;
    }
    uint point[4];
    for (uint k = 0u; k < 4u; ++k) point[k] = first + k;
    for (uint k = 1u; k < 4u; ++k) {
        bool together = pixel[k] == pixel[k - 1u];
        bool nearer = together && depth[k - 1u] <= depth[k];
        depth[k] = nearer ? depth[k - 1u] : depth[k];
        point[k] = nearer ? point[k - 1u] : point[k];
        pixel[k - 1u] = together ? NO_PIXEL : pixel[k - 1u];
    }
    if (SHALLOW) {
        for (uint k = 0u; k < 4u; ++k) {
            bool is_empty = seen[k] == 0xFFFFFFFFu;
            bool is_shallow = is_empty || depth[k] <= uintBitsToFloat(is_empty ? 0u : seen[k]) + push.epsilon;
            any_shallow = any_shallow || (is_shallow && pixel[k] != NO_PIXEL);
        }
    }
    for (uint k = 0u; k < 4u; ++k) {
        if (pixel[k] != NO_PIXEL && floatBitsToUint(depth[k]) <= seen[k]) meet(pixel[k], depth[k], point[k]);
    }
}
