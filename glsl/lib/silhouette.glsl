// Silhouettes: where depth jumps (Dobrev et al. 2010, sec. 3.5; guide: numerics, case 12). The
// includer has pixel.glsl and, in `push`, `jump`.
//
//   inverse     edge = |laplacian(1/z)| * least z    0 on every plane, whose 1/z is affine with
//                                                    perspective; background is 1/z = 0
//   depth       edge = |laplacian(z)| / least z      the paper's: bends on steep planes; background
//                                                    is z = 0
//   silhouette  edge > jump; with the high threshold also background among the five pixels
// Against background the edge is at least 1 for each side on which it lies, whatever the depth. The
// picture's edge is none: pixels beyond repeat the pixel itself.
layout(constant_id = 0) const bool INVERSE = true;
layout(constant_id = 1) const bool HIGH = false;

// Depths are clamped to this many times the smallest.
const float MOST = 1e6;

bool known(float z) {
    return has_depth(floatBitsToUint(z)) && z > 0.0;
}

// Takes the depths of the pixel, left, right, above, below.
bool silhouette(float z[5]) {
    float least = uintBitsToFloat(BACKGROUND_BITS);
    bool background = false;
    [[unroll]] for (int k = 0; k < 5; ++k) {
        bool has = known(z[k]);
        least = mix(least, min(least, z[k]), has);
        background = background || !has;
    }
    bool any_has = least < uintBitsToFloat(BACKGROUND_BITS);
    least = mix(1.0, least, any_has);
    float laplacian = 0.0;
    [[unroll]] for (int k = 0; k < 5; ++k) {
        bool has = known(z[k]);
        float own = mix(least, z[k], has);
        bool far = own > least * MOST;
        float ratio = INVERSE ? least / own : mix(own, least, far) / least;
        ratio = mix(ratio, MOST, far && !INVERSE);
        laplacian += (k == 0 ? 4.0 : -1.0) * mix(0.0, ratio, has);
    }
    return any_has && abs(laplacian) > push.jump && (background || !HIGH);
}
