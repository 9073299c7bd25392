// Tiles -> lists: which tiles each level of the pyramid has to judge, and then those that any level has to.
//
// A tile is left out of a level where nothing in the level's kernel can lead a point of it, or, of pixels without one, where there is no point at all. Fine levels are left out where all tiles around are
// continuous (classify.comp). Of the others a cell is as large as a tile or larger, and its nearest point can be compared with the tile's farthest one: at a distance d of d_min pixels or more from a
// ray that leans by l, it leads where   (z0 - z) f (1 + l l) > z d (own - l)   at most.
//
// Levels end where points a cell apart would be sparser than surfaces are: those are strays. That goes by the spacing of the node of the tile's nearest point; where the tile has none, of those around; and where those have none, of the sparsest node in view.
//
// A single level has no pyramid: its list holds tiles that are not continuous, or have one beside them that is not.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "tile.glsl"
#include "levels.glsl"

layout(local_size_x = 64) in;

layout(scalar) readonly buffer Tiles { Tile tile[]; } tiles;
layout(r32f) readonly uniform image2D pyramid;
layout(r32f) readonly uniform image2D places;
// Two words a tile: points that may be hidden.
layout(scalar) readonly buffer Candidates { uint word[]; } candidates;
// Two words a tile: points that are known to be hidden.
layout(scalar) readonly buffer Invisible { uint word[]; } invisible;
// Three words a tile: two of pixels to judge, and one with a bit for each level that has to judge them.
layout(scalar) writeonly buffer Asked { uint word[]; } asked;
layout(scalar) buffer Lists { uint word[]; } lists;

layout(constant_id = 0) const uint RADIUS = 3u;
layout(constant_id = 1) const bool PERSPECTIVE = true;
layout(constant_id = 2) const bool EMPTY = false;

layout(push_constant, scalar) uniform Push {
    uvec2 size;        // pixels
    vec2 centre;       // where the camera looks, pixels from the first
    uvec2 tiles;
    float px_per_unit; // perspective: focal length in pixels; orthographic: pixels per metre
    uint stride;       // words from list to list
    int levels;
    float own;         // slope up to which a neighbour may be of the point's own surface
    float sparsest;    // points so many of their node's spacings apart are still of a surface
    float widest;      // spacing of the sparsest node in view, pixels
    uint all;          // 1: no tile is left out
} push;

const float FARTHEST = 3.402823466e38;
// Margin for rounding.
const float SURELY = 1.001;
const int TILE_LEVEL = 3;
const int R = int(RADIUS);

// Says whether a level whose cells are smaller than a tile has something to judge.
bool fine(ivec2 own, int level) {
    ivec2 across = ivec2(push.tiles);
    int span = (((R + 1) << level) + TILE_PX - 1) / TILE_PX;
    bool covered = false;
    bool continuous = true;
    [[dont_unroll]] for (int dy = -span; dy <= span; ++dy) {
        [[dont_unroll]] for (int dx = -span; dx <= span; ++dx) {
            ivec2 at = clamp(own + ivec2(dx, dy), ivec2(0), across - 1);
            Tile tile = tiles.tile[at.y * across.x + at.x];
            covered = covered || (tile.points_left | tile.points_right) > 0u;
            continuous = continuous && tile.continuous == 1u;
        }
    }
    return covered && !continuous;
}

// Says the same of a level with cells as large as a tile or larger.
bool coarse(ivec2 own, int level, float z0) {
    ivec2 size = ivec2(push.size);
    ivec2 cells = level_size(size, level);
    ivec2 corner = level_corner(size, level);
    ivec2 top = TILE_PX * own;
    ivec2 cell = top >> level;
    vec2 first = vec2(top) + 0.5;
    vec2 last = vec2(min(top + TILE_PX, size)) - 0.5;
    vec2 ray = max(abs(first - push.centre), abs(last - push.centre)) / push.px_per_unit;
    float lean = PERSPECTIVE ? sqrt(ray.x * ray.x + ray.y * ray.y) : 0.0;
    float rise = push.px_per_unit * (1.0 + lean * lean) * SURELY;
    float slope = max(push.own - lean, 0.0);
    bool found = false;
    [[dont_unroll]] for (int dy = -R; dy <= R; ++dy) {
        [[dont_unroll]] for (int dx = -R; dx <= R; ++dx) {
            ivec2 to = cell + ivec2(dx, dy);
            ivec2 from = ivec2(at_edge(to.x, cells.x), at_edge(to.y, cells.y));
            float z = imageLoad(pyramid, corner + from).r;
            vec2 at = place_in(to, level, imageLoad(places, corner + from).r);
            vec2 beside = max(max(first - at, at - last), 0.0);
            float run = (PERSPECTIVE ? z : 1.0) * sqrt(beside.x * beside.x + beside.y * beside.y) * slope;
            bool has = z <= FARTHEST;
            found = found || (has && (EMPTY || (z < z0 && (z0 - z) * rise >= run)));
        }
    }
    return found;
}

void main() {
    uint number = gl_GlobalInvocationID.x;
    if (number >= push.tiles.x * push.tiles.y) return;
    ivec2 own = in_rows(number, uint(push.tiles.x));
    Tile tile = tiles.tile[number];
    uvec2 pixels = EMPTY ? uvec2(tile.empty_left, tile.empty_right) : uvec2(tile.points_left, tile.points_right);
    pixels &= ~uvec2(invisible.word[2u * number], invisible.word[2u * number + 1u]);
    pixels &= EMPTY ? uvec2(0xFFFFFFFFu) : uvec2(candidates.word[2u * number], candidates.word[2u * number + 1u]);
    bool wanted = push.all == 1u || push.levels == 1 || pixels != uvec2(0u);
    float spacing = tile.spacing;
    [[dont_unroll]] for (int k = 0; k < 9; ++k) {
        ivec2 at = clamp(own + ivec2(k % 3, k / 3) - 1, ivec2(0), ivec2(push.tiles) - 1);
        float beside = tiles.tile[at.y * int(push.tiles.x) + at.x].spacing;
        spacing = tile.spacing > 0.0 ? spacing : max(spacing, beside);
    }
    spacing = spacing > 0.0 ? spacing : push.widest;
    uint asking = 0u;
    [[dont_unroll]] for (int level = 0; wanted && level < push.levels; ++level) {
        bool may = level == 0 || float(1 << level) <= push.sparsest * spacing;
        bool looks = may && (push.all == 1u || (level < TILE_LEVEL ? fine(own, level) : coarse(own, level, tile.farthest)));
        asking |= uint(looks) << level;
        if (looks) APPEND(lists, uint(level) * push.stride, number)
    }
    if (asking != 0u) APPEND(lists, uint(push.levels) * push.stride, number)
    asked.word[3u * number] = pixels.x;
    asked.word[3u * number + 1u] = pixels.y;
    asked.word[3u * number + 2u] = asking;
}
