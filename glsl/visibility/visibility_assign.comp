// Tiles -> lists of the tiles that each level of the pyramid must judge, and of those that any
// level must.
//
// A level skips a tile if too few cells of its kernels can be in front of a point of the tile, or
// can hold a point at all for pixels without one. Fine levels are skipped if all tiles around are
// continuous (tile_classify.comp). For others, a cell is at least as large as a tile, and its
// nearest point is compared with the tile's farthest: at a distance d of d_min pixels or more from
// a ray that leans by l, it is in front at most if   (z0 - z) f (1 + l l) > z d (own - l).
//
// A pixel without a point needs points on all sides, too: left and right, above and below.
//
// For points, levels end where points a cell apart would be sparser than surfaces are; those are
// strays. That follows from the spacing of the node of the tile's nearest point, else from the
// tiles around.
//
// A single level has no pyramid: its list holds tiles that are not continuous or have such a
// neighbour.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "tile.glsl"
#include "depth_pyramid.glsl"

layout(local_size_x = 64) in;

layout(scalar) readonly buffer Tiles { Tile tile[]; } tiles;
layout(rgba32f) readonly uniform image2D pyramid;
// Points that may be hidden, or pixels without one that the finest level has decided, two words per
// tile.
layout(scalar) readonly buffer Candidates { uint word[]; } candidates;
// Points that are known to be hidden, two words per tile.
layout(scalar) readonly buffer Invisible { uint word[]; } invisible;
// Three words per tile: two of pixels to judge, and one with a bit for each level that must judge
// them.
layout(scalar) writeonly buffer Asked { uint word[]; } asked;
layout(scalar) buffer Lists { uint word[]; } lists;

layout(constant_id = 0) const uint RADIUS = 3u;
layout(constant_id = 1) const bool PERSPECTIVE = true;
layout(constant_id = 2) const bool EMPTY = false;

layout(push_constant, scalar) uniform Push {
    uvec2 size;        // pixels
    vec2 centre;       // principal point [px]
    uvec2 tiles;
    float px_per_unit; // perspective: focal length in pixels; orthographic: pixels per metre
    uint stride;       // words from list to list
    int levels;
    int fewest;        // smallest number of points that decides anything
    float own;         // slope of the steepest own surface
    float sparsest;    // largest spacing on a surface, in node spacings
    uint empties;      // 1: the finest level judges pixels without a point, too
    uint all;          // 1: all tiles
} push;

const float FARTHEST = 3.402823466e38;
// Margin for rounding.
const float SURELY = 1.001;
const int TILE_LEVEL = 3;
const int R = int(RADIUS);

// Returns the first or last bytes of a word.
uint some_bytes(int many, bool last) {
    uint shift = uint(32 - 8 * clamp(many, 0, 4));
    return many <= 0 ? 0u : last ? 0xFFFFFFFFu << shift : 0xFFFFFFFFu >> shift;
}

// Returns the number of tiles to either side that begin within a number of pixels.
int tiles_within(int reach) {
    return (reach + TILE_PX - 1) / TILE_PX;
}

// Returns the pixels of a tile no farther than `reach` from another tile, `beside` tiles away.
uvec2 within(ivec2 beside, int reach) {
    ivec2 many = mix(min(reach - TILE_PX * (abs(beside) - 1), TILE_PX), ivec2(TILE_PX), equal(beside, ivec2(0)));
    uint rows = beside.y < 0 ? 0xFFu << (TILE_PX - many.y) & 0xFFu : 0xFFu >> (TILE_PX - many.y);
    bool last = beside.x < 0;
    return uvec2(some_bytes(last ? many.x - 4 : many.x, last), some_bytes(last ? many.x : many.x - 4, last)) & rows * 0x01010101u;
}

// Returns the levels with cells smaller than a tile that have something to judge, a bit each.
uint fine(ivec2 own) {
    ivec2 across = ivec2(push.tiles);
    int levels = min(push.levels, TILE_LEVEL);
    int span = tiles_within(R << (levels - 1));
    int covered[TILE_LEVEL] = int[TILE_LEVEL](0, 0, 0);
    bool continuous[TILE_LEVEL] = bool[TILE_LEVEL](true, true, true);
    [[dont_unroll]] for (int dy = -span; dy <= span; ++dy) {
        [[dont_unroll]] for (int dx = -span; dx <= span; ++dx) {
            ivec2 at = own + ivec2(dx, dy);
            ivec2 inside = clamp(at, ivec2(0), across - 1);
            Tile tile = tiles.tile[inside.y * across.x + inside.x];
            uvec2 points = EMPTY ? ~uvec2(tile.empty_left, tile.empty_right) : uvec2(tile.points_left, tile.points_right);
            [[unroll]] for (int level = 0; level < TILE_LEVEL; ++level) {
                int reach = R << level;
                uvec2 near = points & within(ivec2(dx, dy), reach);
                bool reached = max(abs(dx), abs(dy)) <= tiles_within(reach);
                // Edge points are repeated beyond the picture.
                int many = at == inside ? bitCount(near.x) + bitCount(near.y) : near != uvec2(0u) ? push.fewest : 0;
                covered[level] += reached ? many : 0;
                continuous[level] = continuous[level] && (!reached || tile.continuous == 1u);
            }
        }
    }
    uint looks = 0u;
    [[unroll]] for (int level = 0; level < TILE_LEVEL; ++level) {
        looks |= level < levels && covered[level] >= push.fewest && !continuous[level] ? 1u << level : 0u;
    }
    return looks;
}

// Returns whether points `spacing` pixels apart are dense enough to be a surface at a level.
bool may_judge(int level, float spacing) {
    return float(1 << level) <= push.sparsest * spacing;
}

// Returns whether a level with cells as large as a tile or larger has something to judge.
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
    int found = 0;
    bvec2 before = bvec2(!EMPTY);
    bvec2 after = bvec2(!EMPTY);
    [[dont_unroll]] for (int dy = -R; dy <= R; ++dy) {
        [[dont_unroll]] for (int dx = -R; dx <= R; ++dx) {
            ivec2 to = cell + ivec2(dx, dy);
            ivec2 from = ivec2(at_edge(to.x, cells.x), at_edge(to.y, cells.y));
            vec4 texel = imageLoad(pyramid, corner + from);
            float z = texel.r;
            vec2 at = place_in(to, level, texel);
            vec2 beside = max(max(first - at, at - last), 0.0);
            float run = (PERSPECTIVE ? z : 1.0) * sqrt(beside.x * beside.x + beside.y * beside.y) * slope;
            bool has = texel.a > 0.0;
            before = bvec2(before.x || (has && at.x <= last.x), before.y || (has && at.y <= last.y));
            after = bvec2(after.x || (has && at.x >= first.x), after.y || (has && at.y >= first.y));
            found += int(has && (EMPTY || (z < z0 && (z0 - z) * rise >= run)));
        }
    }
    return found >= push.fewest && all(before) && all(after);
}

void main() {
    uint number = gl_GlobalInvocationID.x;
    if (number >= push.tiles.x * push.tiles.y) return;
    ivec2 own = in_rows(number, uint(push.tiles.x));
    Tile tile = tiles.tile[number];
    uvec2 pixels = EMPTY ? uvec2(tile.empty_left, tile.empty_right) : uvec2(tile.points_left, tile.points_right);
    pixels &= ~uvec2(invisible.word[2u * number], invisible.word[2u * number + 1u]);
    uvec2 candidate = uvec2(candidates.word[2u * number], candidates.word[2u * number + 1u]);
    pixels &= EMPTY ? ~candidate : candidate;
    bool wanted = push.all == 1u || push.levels == 1 || pixels != uvec2(0u);
    // The finest level judges pixels without a point together with the others.
    bool finest = wanted || (push.empties == 1u && (tile.empty_left | tile.empty_right) != 0u);
    float spacing = tile.spacing;
    [[dont_unroll]] for (int k = 0; k < 9; ++k) {
        ivec2 at = clamp(own + ivec2(k % 3, k / 3) - 1, ivec2(0), ivec2(push.tiles) - 1);
        float beside = tiles.tile[at.y * int(push.tiles.x) + at.x].spacing;
        spacing = tile.spacing > 0.0 ? spacing : max(spacing, beside);
    }
    uint asking = 0u;
    uint fine_levels = finest ? fine(own) : 0u;
    [[dont_unroll]] for (int level = EMPTY ? 1 : 0; level < (wanted ? push.levels : finest ? 1 : 0); ++level) {
        bool may = EMPTY || level == 0 || may_judge(level, spacing);
        bool looks = may && (push.all == 1u || (level < TILE_LEVEL ? (fine_levels >> level & 1u) == 1u : coarse(own, level, tile.farthest)));
        asking |= uint(looks) << level;
        if (looks) APPEND(lists, uint(level) * push.stride, number)
    }
    if (asking != 0u) APPEND(lists, uint(push.levels) * push.stride, number)
    asked.word[3u * number] = pixels.x;
    asked.word[3u * number + 1u] = pixels.y;
    asked.word[3u * number + 2u] = asking;
}
