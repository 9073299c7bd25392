// Which pixels an invocation works on: one of the whole picture, or of listed tiles (lib/tile.glsl). local_size_x = 64.
//
// Declares what the graph binds and sets: passes know nothing of it, and run over the whole picture where the graph was given no area (src/graph/area.rs).
//
layout(r32ui) readonly uniform uimageBuffer area;
layout(constant_id = 20) const bool LISTED = false;

uint listed_tiles() {
    return imageLoad(area, 3).r;
}

// Across and down: a pass would divide for every eight pixels.
ivec2 listed_tile(uint place) {
    uint tile = imageLoad(area, int(LIST_HEADER + place)).r;
    return ivec2(tile & 0xFFFFu, tile >> 16);
}

// Its number, row by row.
uint listed_number(uint place, uint tiles_across) {
    ivec2 tile = listed_tile(place);
    return uint(tile.y) * tiles_across + uint(tile.x);
}

// Runs `work` for pixels, or for texels of `rows` rows of pixels each, also for some beyond the picture's edges.
#define EACH_OWN_TEXEL(rows, work) { \
    if (!LISTED) work(ivec2(gl_GlobalInvocationID.xy)); \
    EACH_TEXEL_OF(LISTED ? listed_tiles() : 0u, listed_tile, rows, work) \
}

#define EACH_OWN_PIXEL(work) EACH_OWN_TEXEL(1, work)
