// How the points of a clump lie: consecutive points of a node (src/index/format/scatter.rs).
// Declares no bindings.
struct Clump {
    float spacing; // that splats cover [m]
    float scatter; // 0: on a surface; 1/3: in all directions
};

// Clumps of a node follow those of the node before, as many as there are in a whole page.
const uint POINTS_PER_CLUMP_LOG2 = 10u;

uint clump_of(uint point) {
    return point >> POINTS_PER_CLUMP_LOG2;
}
