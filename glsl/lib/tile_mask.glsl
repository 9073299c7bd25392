// The pixels of an invocation: one of the whole picture, or of listed tiles (lib/tile.glsl).
// local_size_x = 64.
//
// Declares what the graph binds and sets. Passes do not see it, and run over the whole picture
// unless the graph was given a tile list (src/graph/tiles.rs).
layout(r32ui) readonly uniform uimageBuffer area;
layout(constant_id = 20) const bool LISTED = false;

uint listed_tiles() {
    return imageLoad(area, 3).r;
}

// Returns column and row: stored, since a division per eight pixels would be slow.
ivec2 listed_tile(uint place) {
    uint tile = imageLoad(area, int(LIST_HEADER + place)).r;
    return ivec2(tile & 0xFFFFu, tile >> 16);
}

// Returns its number, row by row.
uint listed_number(uint place, uint tiles_across) {
    ivec2 tile = listed_tile(place);
    return uint(tile.y) * tiles_across + uint(tile.x);
}

// Runs `work` for pixels, or for texels of `rows` rows of pixels, also for some beyond the
// picture's edges.
#define EACH_OWN_TEXEL(rows, work) { \
    if (!LISTED) work(ivec2(gl_GlobalInvocationID.xy)); \
    EACH_TEXEL_OF(LISTED ? listed_tiles() : 0u, listed_tile, rows, work) \
}

#define EACH_OWN_PIXEL(work) EACH_OWN_TEXEL(1, work)
