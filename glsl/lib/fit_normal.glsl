// The normal of the surface in a depth image, fitted to a pixel's neighbourhood. Declares no
// bindings.
//
// On a plane 1/z is affine over a picture with perspective, z over one without. So with differences
// to the pixel's own depth z0, which are exact near it,
//   q = (z0 - z) / z, or z0 - z,  ~  a dx + b dy + c       least squares over the neighbours of the
//                                                          same surface, dx and dy [px]
//   n ~ -(f a, f b, 1 - (x a + y b)), or -(f a, f b, 1)    right, down, away from the camera; (x, y)
//                                                          pixel from the picture's centre; f [px]
// which faces the camera by construction. A point may lie anywhere in its pixel; fitting more
// pixels reduces that error of the slope.

// Sums over the neighbours that have been added.
struct Fit {
    float weights;
    vec2 first;   // of dx, dy
    vec3 second;  // of dx dx, dx dy, dy dy
    float q;
    vec2 q_first; // of dx q, dy q
};

const Fit NO_FIT = Fit(0.0, vec2(0.0), vec3(0.0), 0.0, vec2(0.0));

// Depths that differ by `reach` or more are of other surfaces. Others weigh (1 - (difference /
// reach)^2)^2 (Tukey's biweight), which hardly bends the slope of a steep surface.
void add_to_fit(inout Fit fit, bool has, ivec2 aside, float z, float z0, float reach, bool perspective) {
    bool counts = has && abs(z0 - mix(z0, z, has)) < reach;
    float own = mix(z0, z, counts);
    float difference = z0 - own;
    float part = difference / reach;
    float inner = 1.0 - part * part;
    float w = mix(0.0, inner * inner, counts);
    float q = perspective ? difference / own : difference;
    vec2 d = vec2(aside);
    fit.weights += w;
    fit.first += vec2(w) * d;
    fit.second += vec3(w) * vec3(d.x * d.x, d.x * d.y, d.y * d.y);
    fit.q += w * q;
    fit.q_first += vec2(w * q) * d;
}

// Returns the unit normal; 0 if neighbours lie in a line, or there are none.
vec3 normal_of(Fit fit, vec2 from_centre, float px_per_unit, bool perspective) {
    float n = max(fit.weights, 1.0);
    vec2 mean = fit.first / vec2(n);
    float xx = fit.second.x - fit.first.x * mean.x;
    float xy = fit.second.y - fit.first.x * mean.y;
    float yy = fit.second.z - fit.first.y * mean.y;
    float xq = fit.q_first.x - fit.q * mean.x;
    float yq = fit.q_first.y - fit.q * mean.y;
    float determinant = xx * yy - xy * xy;
    // A third for three pixels in a corner, hundreds for a window that sees a surface.
    bool spread = determinant > 0.1;
    float share = 1.0 / mix(1.0, determinant, spread);
    float a = (xq * yy - yq * xy) * share;
    float b = (yq * xx - xq * xy) * share;
    float away = perspective ? 1.0 - (from_centre.x * a + from_centre.y * b) : 1.0;
    vec3 towards = -vec3(px_per_unit * a, px_per_unit * b, away);
    return mix(vec3(0.0), unit(towards), bvec3(spread));
}
