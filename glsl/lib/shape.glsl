// One level of shape depiction at one pixel, for shape.comp and shape_level.comp, which include
// neighborhood.glsl. Declares no bindings.
//
//   mu, sigma = mean and standard deviation of the depths in the 3 x 3, of differences to the centre
//   dmin = mu - sigma, dmax = mu + sigma
//   omega = clamp(1 - |d - dmin| / (dmax - dmin + eps), 0, 1)
//   next d = (mu + dmin) / 2 = mu - sigma / 2
// eps is the width of `softness` pixels: a surface that rises by less from pixel to pixel faces the
// viewer and is bright; a steeper one darkens towards one half.

struct Level {
    float omega; // 1 without depth
    float next;
    bool flat_;  // locally a plane: deeper levels give the same omega
};

// Takes the 3 x 3 row by row; `width` is of `softness` pixels: metres, or a share of the depth with
// perspective.
Level level_of(float z[9], float width, bool perspective) {
    bool point = z[4] < NO_DEPTH;
    float z0 = point ? z[4] : 1.0;
    float count = 0.0;
    float sum = 0.0;
    [[unroll]] for (int k = 0; k < 9; ++k) {
        bool has = z[k] < NO_DEPTH;
        count += float(has);
        sum += mix(0.0, z[k] - z0, has);
    }
    float mu = sum / max(count, 1.0);
    float squares = 0.0;
    [[unroll]] for (int k = 0; k < 9; ++k) {
        float off = mix(0.0, (z[k] - z0) - mu, z[k] < NO_DEPTH);
        squares += off * off;
    }
    float sigma = sqrt(squares / max(count, 1.0));
    float eps = max(perspective ? width * z0 : width, z0 * 9.5367431640625e-7);
    // d is 0 here.
    float spread = 2.0 * sigma + eps;
    float omega = clamp(1.0 - abs(sigma - mu) / spread, 0.0, 1.0);
    float next = max(z0 + (mu - 0.5 * sigma), 0.5 * z0);
    bool plane = count == 9.0 && abs(mu) * 256.0 <= spread;
    return Level(point ? omega : 1.0, point ? next : NO_DEPTH, plane || !point);
}
