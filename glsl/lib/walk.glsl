// The walk over points that every way of projecting shares: one workgroup takes one chunk of one node in LANES lanes.
// The includer has `nodes`, `chunks`, project.glsl, and `meet`, which is called for every point that falls into the band.

void main() {
    uint index = gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x;
    if (index >= push.chunk_count) return;
    uint chunk = chunks.chunk[push.first_chunk + index];
    uint n = chunk >> 6;
    uint first = (chunk & 63u) * push.points_per_chunk;
    uint count = min(nodes.node[n].count - first, push.points_per_chunk);
    vec4 row_x = nodes.node[n].row_x;
    vec4 row_y = nodes.node[n].row_y;
    vec4 row_z = nodes.node[n].row_z;
    ivec3 nearest = nodes.node[n].nearest;
    uint first_point = nodes.node[n].first_point;
    Plane coarse = Plane(nodes.node[n].position[0]);
    Plane fine = Plane(nodes.node[n].position[1]);
    Plane rest = Plane(nodes.node[n].position[2]);

    // Lanes are LANES apart (coalesced loads, GPUs) or walk runs of their own (CPUs).
    uint start = first + gl_LocalInvocationID.x;
    uint stride = LANES;
    uint end = first + count;
    if (OWN_RUN) {
        uint own = (count + LANES - 1u) / LANES;
        start = first + gl_LocalInvocationID.x * own;
        stride = 1u;
        end = min(start + own, end);
    }
    for (uint i = start; i < end; i += stride) {
        ivec3 cells = unpack_cells(coarse.word[i]);
        if (PLANES > 1u) cells = (cells << 10) | unpack_cells(fine.word[i]);
        if (PLANES > 2u) cells = (cells << 10) | unpack_cells(rest.word[i]);
        float depth;
        uint pixel = place(row_x, row_y, row_z, cells - nearest, depth);
        if (pixel == NO_PIXEL) continue;
        meet(pixel, depth, first_point + i);
    }
}
