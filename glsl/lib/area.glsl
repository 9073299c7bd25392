// Which pixels an invocation works on: one of the whole picture, or of listed tiles (lib/tile.glsl). A workgroup takes eight of these at a time, eight lanes a row of each, one tile after the other: lanes
// side by side, and a row of what is most often a row of tiles, so that memory is read in the order in which a pass over the whole picture reads it. Column by column, tile by tile, costs a software
// device a quarter more. local_size_x = 64.
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
    const uint DOWN = uint(TILE_PX / (rows)); \
    uint lanes = gl_LocalInvocationID.x / 8u; \
    ivec2 own = ivec2(gl_LocalInvocationID.x % 8u, lanes * DOWN / TILES_PER_GROUP); \
    uint end = LISTED ? listed_tiles() : 0u; \
    uint n = gl_WorkGroupID.x * TILES_PER_GROUP + lanes * DOWN % TILES_PER_GROUP; \
    uint to_go = DOWN; \
    if (n < end) for (;;) { \
        work(listed_tile(n) * ivec2(TILE_PX, DOWN) + own); \
        to_go -= 1u; \
        n += to_go > 0u ? 1u : TO_NEXT_PLACE - DOWN + 1u; \
        to_go = to_go > 0u ? to_go : DOWN; \
        if (n >= end) break; \
    } \
}

#define EACH_OWN_PIXEL(work) EACH_OWN_TEXEL(1, work)
