// A drawn node and its points: what project, resolve and their twins share. Declares no bindings.

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
    uint first_point;  // number of the node in the frame * POINTS_PER_PAGE
    uint first_word;   // of the coarsest position plane in its block; the finer planes follow, a page each
    uint shown_word;   // of what its points show, in the same block
    uint first_kind;   // the word of its first point's kind in its block, where points have brought theirs
    uint first_normal; // the same of their normals
    // Of a normal, world: its products with these, times x, y and depth, add up to more than 0 where it faces away from the camera.
    vec3 right;
    vec3 down;
    vec3 forward;
    // Where clip boxes leave some of its points: in `within`, from the first on those of which one has to hold a point that is there, from the second on those of which none may, and the end.
    uvec3 boxes;
};

// Cells of the planes that a node is drawn from, both ends included.
struct Within {
    ivec3 least;
    ivec3 most;
};

const uint POINTS_PER_PAGE_LOG2 = 16u;
const uint POINTS_PER_PAGE = 1u << POINTS_PER_PAGE_LOG2;

// Ten bits an axis, x lowest.
ivec3 unpack_cells(uint word) {
    return ivec3(word & 1023u, (word >> 10) & 1023u, word >> 20);
}
