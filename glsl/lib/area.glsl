// Which pixel an invocation works on: one of the whole picture, or one of tiles that are listed (lib/tile.glsl). local_size_x = 64.
//
// Declares what the graph binds and sets: passes know nothing of it, and run over the whole picture where the graph was given no area (src/graph/area.rs).
//
layout(scalar) readonly buffer Area { uint word[]; } area;
layout(constant_id = 20) const bool LISTED = false;

// Beyond every picture.
const ivec2 NOWHERE = ivec2(0x7FFFFFFF);

uint listed_tiles() {
    return area.word[3];
}

uint listed_tile(uint place) {
    return area.word[AREA_HEADER + place];
}

uint listed_group() {
    return gl_WorkGroupID.y * AREA_ROW + gl_WorkGroupID.x;
}

ivec2 corner_of_listed(uint place, uint width_px) {
    bool is_one = place < listed_tiles();
    uint tile = listed_tile(is_one ? place : 0u);
    return is_one ? tile_corner(tile, (width_px + uint(TILE_PX) - 1u) / uint(TILE_PX)) : NOWHERE;
}

// Of this invocation, in a picture so wide; NOWHERE, where the list has ended.
ivec2 own_pixel(uint width_px) {
    if (!LISTED) return ivec2(gl_GlobalInvocationID.xy);
    ivec2 corner = corner_of_listed(listed_group(), width_px);
    uint lane = gl_LocalInvocationID.x;
    return corner == NOWHERE ? NOWHERE : corner + ivec2(lane % 8u, lane / 8u);
}

// The same of images with four rows a texel.
ivec2 own_texel(uint width_px) {
    if (!LISTED) return ivec2(gl_GlobalInvocationID.xy);
    uint lane = gl_LocalInvocationID.x;
    ivec2 corner = corner_of_listed(4u * listed_group() + lane / 16u, width_px);
    return corner == NOWHERE ? NOWHERE : ivec2(corner.x + lane % 8u, corner.y / 4 + lane / 8u % 2u);
}
