// A drawn node and its points: what project, resolve and their twins share. Declares no bindings.

// One plane of one node: a page of 32-bit words.
layout(buffer_reference, scalar, buffer_reference_align = 4) readonly buffer Plane { uint word[]; };

// All of it is computed on the CPU in f64 and rounded once. A point at cells q lies at
//   (x, y, depth) = row_*.xyz . (q - nearest) + row_*.w
// in pixels * depth (perspective) or pixels (orthographic) from the picture's centre, and in metres.
// `nearest` is the cell of the node nearest to the camera: the integer difference is exact, and row_*.w stays small
// beside the result wherever the camera is, also within the node (HARD_CASES 1.2).
struct Node {
    vec4 row_x;
    vec4 row_y;
    vec4 row_z;
    ivec3 nearest;
    uint count;
    uint first_point;  // page * POINTS_PER_PAGE
    uvec2 position[3]; // device address of the position planes, coarsest first
};

// Ten bits an axis, x lowest.
ivec3 unpack_cells(uint word) {
    return ivec3(word & 1023u, (word >> 10) & 1023u, word >> 20);
}
