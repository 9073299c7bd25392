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
    uint coarse = nodes.node[n].first_word;
    uint fine = coarse + POINTS_PER_PAGE;
    uint finest = fine + POINTS_PER_PAGE;

    // Lanes side by side: loads are coalesced on a GPU and gathered from one cache line on a CPU.
    for (uint i = first + gl_LocalInvocationID.x; i < first + count; i += LANES) {
        ivec3 cells = unpack_cells(texelFetch(pages, int(coarse + i)).r);
        if (PLANES > 1u) cells = (cells << 10) | unpack_cells(texelFetch(pages, int(fine + i)).r);
        if (PLANES > 2u) cells = (cells << 10) | unpack_cells(texelFetch(pages, int(finest + i)).r);
        float depth;
        uint pixel = place(row_x, row_y, row_z, cells - nearest, depth);
        if (pixel == NO_PIXEL) continue;
        meet(pixel, depth, first_point + i);
    }
}
