// Discs of points -> keys. The includer declares `keys` and `meet(pixel, depth, point)`.
//
// A point covers the pixels whose centres lie within its radius around its own. A paraboloid bends
// away from the viewer by its radius at the rim, so that neighbours meet halfway (Schütz 2016).

layout(r32f) readonly uniform image2D depth;
layout(r32ui) readonly uniform uimage2D index;
layout(scalar) readonly buffer Clumps { Clump clump[]; } clumps;
// Pixels with a point, and their number in the last word of `counts` (splat_points.comp).
layout(scalar) readonly buffer Counts { uint word[]; } counts;
layout(scalar) readonly buffer Points { uint pixel[]; } points;

layout(constant_id = 0) const bool PERSPECTIVE = true;

layout(push_constant, scalar) uniform Push {
    uvec2 size;      // pixels of the picture
    uint top;        // first row of the strip
    uint rows;       // rows of the strip
    float px_per_m;  // pixels of a metre at depth 1, or everywhere without perspective
    float cover;     // radius per point spacing; 0: not by spacing
    float metres;    // radius [m]; 0: not by metres
    float pixels;    // radius otherwise [px]
    float largest;   // largest radius [px]
    float bulge;     // depth of the rim behind the point, per radius
} push;

// Draws the disc of a point of the list.
void draw(uint n) {
    uint entry = points.pixel[n];
    ivec2 at = ivec2(entry & 0xFFFFu, entry >> 16);
    ivec2 size = ivec2(push.size);
    int bottom = int(push.top + push.rows);
    float z = imageLoad(depth, at).r;
    float spacing = clumps.clump[clump_of(imageLoad(index, at).r)].spacing;
    float scale = PERSPECTIVE ? push.px_per_m / z : push.px_per_m;
    // A point lies up to half a pixel beside the centre of its own.
    float radius = push.cover > 0.0 ? push.cover * spacing * scale + 0.5
        : push.metres > 0.0 ? push.metres * scale : push.pixels;
    radius = clamp(radius, 0.5, push.largest);
    float square = radius * radius;
    float bulge = push.bulge * radius / (scale * square);
    int reach = int(radius);
    uint source = uint(at.y) * push.size.x + uint(at.x);
    ivec2 least = max(ivec2(at.x - reach, at.y - reach), ivec2(0, int(push.top)));
    ivec2 most = min(at + reach, ivec2(size.x - 1, bottom - 1));
    for (int y = least.y; y <= most.y; ++y) {
        for (int x = least.x; x <= most.x; ++x) {
            ivec2 apart = ivec2(x, y) - at;
            float distance = float(apart.x * apart.x + apart.y * apart.y);
            if (distance > square) continue;
            uint pixel = uint(y - int(push.top)) * push.size.x + uint(x);
            meet(pixel, z + bulge * distance, source);
        }
    }
}

void main() {
    uint end = counts.word[3];
    uint n = gl_GlobalInvocationID.x;
    if (n < end) for (;;) {
        draw(n);
        n += 64u * gl_NumWorkGroups.x;
        if (n >= end) break;
    }
}
