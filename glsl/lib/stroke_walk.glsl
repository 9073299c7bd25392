// The loop over points that become strokes: how each lies on the screen, and what it may touch
// there. The includer has `touch`, for a point within the wider view, and `miss`, for one outside.
// Points at one place are one stroke, that of the point that also shows as a point.

#include "point_constants.glsl"
#include "drawn_node.glsl"
#include "stroke.glsl"

// lavapipe ends all loops of an invocation after 65,535 rounds, and a stroke near the camera
// touches thousands of tiles.
layout(constant_id = 10) const uint SLICES_OF_CHUNK = 1u;
#define SLICES SLICES_OF_CHUNK
// True if opacities depend on kinds of points.
layout(constant_id = 9) const bool BY_KIND = false;

layout(buffer_reference, scalar, buffer_reference_align = 4) readonly buffer Plane { uint word[]; };

layout(scalar) readonly buffer Nodes { Node node[]; } nodes;
// Factors of opacity (lib/point_kind.glsl).
layout(scalar) readonly buffer Opacities { float factor[]; } opacities;
// Clip boxes of nodes with points on both sides.
layout(scalar) readonly buffer Boxes { Within cells[]; } within;
layout(scalar) readonly buffer Chunks { uint chunk[]; } chunks;
// Pages of a block, as texels of four words; and as words if texel buffers are too small.
layout(rgba32ui) readonly uniform uimageBuffer pages;
layout(scalar) readonly buffer PageWords { uvec4 four[]; } page_words;
layout(scalar) readonly buffer Homes { Home home[]; } homes;
layout(scalar) readonly buffer Turns { vec2 turn[]; } turns;
layout(scalar) readonly buffer Canvases { Canvas canvas[]; } canvases;

#include "project.glsl"

// A point in view: offset from the picture's centre [px], and depth.
struct Seen {
    vec2 off;
    float depth;
};

// A point that becomes a stroke: its node, its place there, and its two words.
struct Stroked {
    Home home;
    uint n;
    uint i;
    uint facing;
    uint brush;
};

// Returns the point at full precision.
Seen seen_of(Stroked point) {
    Plane plane = Plane(point.home.page);
    ivec3 cells = ivec3(0);
    for (uint p = 0u; p < point.home.planes; ++p) cells = (cells << 10) | unpack_cells(plane.word[p * POINTS_PER_PAGE + point.i]);
    vec3 d = vec3(cells - nodes.node[point.n].nearest);
    float depth = row(nodes.node[point.n].row_z, d);
    float deep = PERSPECTIVE ? depth : 1.0;
    return Seen(vec2(row(nodes.node[point.n].row_x, d), row(nodes.node[point.n].row_y, d)) / vec2(deep), depth);
}

// Tests whether the point before is at the same place, and of the same kind if opacities depend on
// it. Points of a node are in the order of their places.
bool repeats(Home home, uint i) {
    Plane plane = Plane(home.page);
    uint before = max(i, 1u) - 1u;
    bool same = i > 0u;
    for (uint p = 0u; p < home.planes; ++p) same = same && plane.word[p * POINTS_PER_PAGE + i] == plane.word[p * POINTS_PER_PAGE + before];
    uint kinds = (home.planes + canvases.canvas[0].kind) * POINTS_PER_PAGE;
    if (BY_KIND || BY_OPACITY) same = same && plane.word[kinds + i] == plane.word[kinds + before];
    return same;
}

Square seen_square(Canvas canvas, Seen seen, Stroked point) {
    vec3 sight = PERSPECTIVE ? sight_of(canvas, seen.off) : canvas.forward;
    float deep = PERSPECTIVE ? seen.depth : 1.0;
    return square_of(canvas, point.facing, point.brush, sight, canvas.focal / deep, turns.turn[turn_of(point.brush)]);
}

// Returns constants for pixels: with `off` from the centre [px], w = 1 + dot(turning, off), (u, v)
// = (dot(across, off), dot(along, off)) / w: centre, turning; across, along.
uvec4[2] lying(Canvas canvas, Square square, Seen seen) {
    float deep = PERSPECTIVE ? seen.depth : 1.0;
    // In view space, for pixels at a depth of one.
    vec3 to_pixels = vec3(vec2(1.0 / (canvas.focal * canvas.focal)), 1.0);
    vec3 normal = to_view(canvas, square.normal) * to_pixels;
    vec3 t = to_view(canvas, square.tangent) * to_pixels;
    vec3 b = to_view(canvas, square.bitangent) * to_pixels;
    vec3 ray = PERSPECTIVE ? vec3(seen.off, 1.0) : vec3(0.0, 0.0, 1.0);
    // A square seen edge-on is invisible, but has no infinity.
    float m = min(dot_of(normal, ray), -1e-5);
    vec2 sides = vec2(0.5 * deep) / square.half_side;
    vec2 turning = normal.xy / vec2(m);
    vec2 across = (t.xy - turning * vec2(dot_of(t, ray))) * vec2(sides.x);
    vec2 along = (b.xy - turning * vec2(dot_of(b, ray))) * vec2(sides.y);
    return uvec4[2](floatBitsToUint(vec4(seen.off + canvas.middle, turning)), floatBitsToUint(vec4(across, along)));
}

// Returns the corners on the screen of what a brush covers of a square, from the picture's centre
// [px]: -t -b, +t -b, -t +b, +t +b.
vec2[4] corners_of(Canvas canvas, Square square, Seen seen, out bool is_before) {
    float deep = PERSPECTIVE ? seen.depth : 1.0;
    vec2 reach = canvas.reach * square.half_side * vec2(2.0);
    vec3 t = to_view(canvas, square.tangent) * vec3(reach.x);
    vec3 b = to_view(canvas, square.bitangent) * vec3(reach.y);
    // Corners behind the camera are far aside.
    float least = 0.02 * deep;
    is_before = true;
    vec2 corners[4];
    for (uint corner = 0u; corner < 4u; ++corner) {
        vec3 aside = ((corner & 1u) == 0u ? -t : t) + ((corner & 2u) == 0u ? -b : b);
        float z = PERSPECTIVE ? deep + aside.z : 1.0;
        is_before = is_before && z >= least;
        corners[corner] = (seen.off * vec2(deep) + aside.xy) / vec2(max(z, least));
    }
    return corners;
}

void touch(Stroked point);
void miss(Stroked point);

void four(uint pixel[4], float depth[4], uint first) {
    uint chunk = chunks.chunk[push.first_chunk + gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x];
    Home home = homes.home[first >> POINTS_PER_PAGE_LOG2];
    uint i = first & (POINTS_PER_PAGE - 1u);
    uint page = (home.planes + canvases.canvas[0].word) * POINTS_PER_PAGE + i;
    for (uint k = 0u; k < 4u; ++k) {
        uint facing = Plane(home.page).word[page + k];
        uint brush = Plane(home.page).word[page + POINTS_PER_PAGE + k];
        Stroked point = Stroked(home, chunk / CHUNKS_PER_PAGE, i + k, facing, brush);
        if (pixel[k] != NO_PIXEL && !repeats(home, i + k)) touch(point);
        else miss(point);
    }
}

#include "point_loop.glsl"
