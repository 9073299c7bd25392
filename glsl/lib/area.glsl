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

uint listed_tile(uint place) {
    return imageLoad(area, int(LIST_HEADER + place)).r;
}

// Runs `work` for pixels, or for texels of `rows` rows of pixels each, of a picture so wide; also for some beyond its edges.
#define EACH_OWN_TEXEL(width_px, rows, work) { \
    if (!LISTED) work(ivec2(gl_GlobalInvocationID.xy)); \
    const uint DOWN = uint(TILE_PX / (rows)); \
    uint across = ((width_px) + uint(TILE_PX) - 1u) / uint(TILE_PX); \
    uint lanes = gl_LocalInvocationID.x / 8u; \
    ivec2 row = ivec2(0, lanes * DOWN / TILES_PER_GROUP); \
    uint end = LISTED ? listed_tiles() : 0u; \
    uint n = gl_WorkGroupID.x * TILES_PER_GROUP + lanes * DOWN % TILES_PER_GROUP; \
    uint to_go = DOWN; \
    if (n < end) for (;;) { \
        work(column_of(listed_tile(n), across) / ivec2(1, rows) + row); \
        to_go -= 1u; \
        n += to_go > 0u ? 1u : TO_NEXT_PLACE - DOWN + 1u; \
        to_go = to_go > 0u ? to_go : DOWN; \
        if (n >= end) break; \
    } \
}

#define EACH_OWN_PIXEL(width_px, work) EACH_OWN_TEXEL(width_px, 1, work)
