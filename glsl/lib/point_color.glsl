// A point's id -> its attribute and opacity. The includer has drawn_node.glsl, `shown`, `kinds` and
// `opacities`, and the constants TRANSPARENT and BY_KIND.

#include "point_kind.glsl"

// Attributes of a node's points: a page of 32-bit words.
layout(buffer_reference, scalar, buffer_reference_align = 4) readonly buffer Plane { uint word[]; };

uint shown_word(uint id) {
    return Plane(shown.page[id >> POINTS_PER_PAGE_LOG2]).word[id & (POINTS_PER_PAGE - 1u)];
}

float own_opacity(uint id) {
    if (!TRANSPARENT) return 1.0;
    uint kind = BY_KIND ? Plane(kinds.page[id >> POINTS_PER_PAGE_LOG2]).word[id & (POINTS_PER_PAGE - 1u)] : 0u;
    return opacity_of(kind);
}
