// A drawn node and its points, shared by project, resolve and their twins. Declares no bindings.

// All of it is computed on the CPU in f64 and rounded once. A point at cells q lies at
//   (x, y, depth) = row_*.xyz . (q - nearest) + row_*.w
// in pixels * depth (perspective) or pixels (orthographic) from the picture's centre, and in
// metres. `nearest` is the cell of the node nearest to the camera: the integer difference is exact,
// and row_*.w stays small compared with the result wherever the camera is, also within the node
// (guide: numerics, case 1).
struct Node {
    vec4 row_x;
    vec4 row_y;
    vec4 row_z;
    ivec3 nearest;
    uint count;
    uint first_point;  // number of the node in the frame * POINTS_PER_PAGE
    uint first_word;   // of the coarsest position plane; finer ones follow, a page each
    uint shown_word;   // of its attributes, in the same block
    uint first_kind;   // word of its first kind in its block, if kinds are known
    uint first_normal; // word of its first normal, likewise
    // For world normals: their products with these, times x, y and depth, add up to more than 0 if
    // they face away from the camera.
    vec3 right;
    vec3 down;
    vec3 forward;
    // Clip boxes that leave some of its points, as a range of `within`: from the first, boxes of
    // which one must hold a point; from the second, boxes of which none may; and the end.
    uvec3 boxes;
};

// Cells of the planes that a node is drawn from, both ends included.
struct Within {
    ivec3 least;
    ivec3 most;
};

const uint POINTS_PER_PAGE_LOG2 = 16u;
const uint POINTS_PER_PAGE = 1u << POINTS_PER_PAGE_LOG2;

// Unpacks ten bits per axis, x lowest.
ivec3 unpack_cells(uint word) {
    return ivec3(word & 1023u, (word >> 10) & 1023u, word >> 20);
}
