// The surface at a pixel, from depth. The includer has `depth`, pixel.glsl, normalize.glsl and
// fit_normal.glsl.

bool known(float z) {
    return has_depth(floatBitsToUint(z)) && z > 0.0;
}

// Returns the normal fitted to a window of `radius_px` around a pixel of known depth z: right,
// down, away; 0 without enough neighbours. Depths that differ by `reach` or more are of other
// surfaces.
vec3 normal_at(ivec2 pixel, float z, int radius_px, float reach, vec2 from_centre, float px_per_unit, bool perspective) {
    Fit fit = NO_FIT;
    // One loop, row by row, tested at its end (see lib/tile.glsl).
    ivec2 aside_px = ivec2(-radius_px);
    for (;;) {
        float other = imageLoad(depth, pixel + aside_px).r;
        add_to_fit(fit, known(other), aside_px, other, z, reach, perspective);
        bool row_ends = aside_px.x == radius_px;
        aside_px = mix(aside_px + ivec2(1, 0), ivec2(-radius_px, aside_px.y + 1), bvec2(row_ends));
        if (aside_px.y > radius_px) break;
    }
    return normal_of(fit, from_centre, px_per_unit, perspective);
}
