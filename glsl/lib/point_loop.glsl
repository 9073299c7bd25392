// The loop over points: one workgroup takes one chunk of one node. The includer has `nodes`,
// `chunks`, `pages`, `opacities`, `within`, project.glsl, and `four`, which takes four neighbours:
// their pixels (NO_PIXEL if outside of the picture), their depths, and the id of the first, or with
// WITH_WORDS their attributes instead of the id.

#include "point_kind.glsl"
#include "octahedral.glsl"

uvec4 four_words(uint i) {
    return TEXELS ? imageLoad(pages, int(i)) : page_words.four[i];
}

bool is_within(ivec3 cells, Within box) {
    return all(greaterThanEqual(cells, box.least)) && all(lessThanEqual(cells, box.most));
}

ivec3 cells_of(uint coarse, uint fine, uint finest) {
    ivec3 cells = unpack_cells(coarse);
    if (PLANES > 1u) cells = (cells << 10) | unpack_cells(fine);
    if (PLANES > 2u) cells = (cells << 10) | unpack_cells(finest);
    return cells;
}

// Number of listed chunks.
#ifndef CHUNKS_TO_WALK
#define CHUNKS_TO_WALK push.chunk_count
#endif

// Workgroups that share a chunk, adjacent in z.
#ifndef SLICES
#define SLICES 1u
#endif

// By its place in the list.
#ifndef IS_TO_BE_WALKED
#define IS_TO_BE_WALKED(at) true
#define WALKED(at)
#endif

void main() {
    uint index = gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x;
    if (index >= CHUNKS_TO_WALK) return;
    uint at = push.first_chunk + index;
    if (!IS_TO_BE_WALKED(at)) return;
    uint chunk = chunks.chunk[at];
    uint n = chunk / CHUNKS_PER_PAGE;
    uint first = chunk % CHUNKS_PER_PAGE * POINTS_PER_CHUNK + gl_WorkGroupID.z * (POINTS_PER_CHUNK / SLICES);
    uint end = min(nodes.node[n].count, first + POINTS_PER_CHUNK / SLICES);
    vec4 row_x = nodes.node[n].row_x;
    vec4 row_y = nodes.node[n].row_y;
    vec4 row_z = nodes.node[n].row_z;
    ivec3 nearest = nodes.node[n].nearest;
    uint first_point = nodes.node[n].first_point;
    // Planes of a node follow each other, one page each.
    uint plane = nodes.node[n].first_word / 4u;
    uint shown = nodes.node[n].shown_word / 4u;
    uint kind = nodes.node[n].first_kind / 4u;
    uint normal = nodes.node[n].first_normal / 4u;
    vec3 right = nodes.node[n].right;
    vec3 down = nodes.node[n].down;
    vec3 forward = nodes.node[n].forward;
    uvec3 boxes = nodes.node[n].boxes;

    // A lane reads four words of a plane at once, which is one gathered load.
    for (uint i = first + 4u * gl_LocalInvocationID.x; i < end; i += 4u * LANES) {
        uvec4 coarse = four_words(plane + i / 4u);
        uvec4 fine = PLANES > 1u ? four_words(plane + (POINTS_PER_PAGE + i) / 4u) : uvec4(0u);
        uvec4 finest = PLANES > 2u ? four_words(plane + (2u * POINTS_PER_PAGE + i) / 4u) : uvec4(0u);
        uvec4 kinds = BY_OPACITY ? four_words(kind + i / 4u) : uvec4(0u);
        uvec4 normals = ONE_SIDED ? four_words(normal + i / 4u) : uvec4(UNKNOWN_NORMAL);
        // Loads are outside of conditions: in a divergent branch lavapipe loads lane by lane.
        uint pixel[4];
        float depth[4];
        bool there[4] = bool[4](true, true, true, true);
        if (CLIPPED) {
            // A box is loaded once for four points.
            bool kept[4] = bool[4](false, false, false, false);
            for (uint b = boxes.x; b < boxes.z; ++b) {
                Within box = within.cells[b];
                for (uint k = 0u; k < 4u; ++k) {
                    bool inside = is_within(cells_of(coarse[k], fine[k], finest[k]), box);
                    kept[k] = kept[k] || (inside && b < boxes.y);
                    there[k] = there[k] && !(inside && b >= boxes.y);
                }
            }
            for (uint k = 0u; k < 4u; ++k) there[k] = there[k] && (kept[k] || boxes.x == boxes.y);
        }
        for (uint k = 0u; k < 4u; ++k) {
            ivec3 cells = cells_of(coarse[k], fine[k], finest[k]);
            pixel[k] = place(row_x, row_y, row_z, cells - nearest, depth[k]);
            pixel[k] = i + k < end ? pixel[k] : NO_PIXEL;
            if (BY_OPACITY) pixel[k] = opacity_of(kinds[k]) > 0.0 ? pixel[k] : NO_PIXEL;
            if (CLIPPED) pixel[k] = there[k] ? pixel[k] : NO_PIXEL;
            if (ONE_SIDED) {
                vec3 d = vec3(cells - nearest);
                vec3 world = normal_of(normals[k]);
                float away = dot_of(right, world) * row(row_x, d) + dot_of(down, world) * row(row_y, d) + dot_of(forward, world) * row(row_z, d);
                bool is_back = away > 0.0 && (normals[k] & UNKNOWN_NORMAL) != UNKNOWN_NORMAL;
                pixel[k] = is_back ? NO_PIXEL : pixel[k];
            }
        }
#ifdef WITH_WORDS
        four(pixel, depth, four_words(shown + i / 4u));
#else
        four(pixel, depth, first_point + i);
#endif
    }
    WALKED(at);
}
