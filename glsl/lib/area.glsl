// Which pixels an invocation works on: one of the whole picture, or a column of a tile that is listed, from top to bottom (lib/tile.glsl): what a column's pixels share is found once, and a tile is looked up
// once for eight of them, which costs a software device as much as some passes do. local_size_x = 64.
//
// Declares what the graph binds and sets: passes know nothing of it, and run over the whole picture where the graph was given no area (src/graph/area.rs).
//
layout(scalar) readonly buffer Area { uint word[]; } area;
layout(constant_id = 20) const bool LISTED = false;

uint listed_tiles() {
    return area.word[3];
}

uint listed_tile(uint place) {
    return area.word[LIST_HEADER + place];
}

// Runs `work` for pixels, or for texels of `rows` rows of pixels each, of a picture so wide; also for some beyond its edges.
#define EACH_OWN_TEXEL(width_px, rows, work) { \
    if (!LISTED) work(ivec2(gl_GlobalInvocationID.xy)); \
    uint end = LISTED ? listed_tiles() : 0u; \
    uint n = FIRST_PLACE; \
    if (n < end) for (;;) { \
        ivec2 own = column_of(listed_tile(n), ((width_px) + uint(TILE_PX) - 1u) / uint(TILE_PX)) / ivec2(1, rows); \
        for (int row = 0;;) { \
            work(own + ivec2(0, row)); \
            row += 1; \
            if (row == TILE_PX / rows) break; \
        } \
        n += TO_NEXT_PLACE; \
        if (n >= end) break; \
    } \
}

#define EACH_OWN_PIXEL(width_px, work) EACH_OWN_TEXEL(width_px, 1, work)
