// Steps from one image into another until nothing changes: the tiles that a step works on, and
// whether there is another. Declares no bindings.
//
// A tile is skipped if nothing changed in the step before, in it or next to it: both images hold
// the same there. `steps` is four words per step: three of the dispatch, which is empty if nothing
// changed in the step before, and a spare; then for every tile the last step that changed a pixel
// of it or next to it.
//
// The includer has `steps`, also bound as `step_words`, and in `push`: `tiles`, across and down;
// `step`, from 1; `woken_at`, the first tile's word; `most_groups` of a dispatch. It tells which
// tile is at a place, and works on a lane's column of a tile.

// True if a step changed pixels of a lane's column: any, the top one, the bottom one.
struct Changes {
    bool any;
    bool top;
    bool bottom;
};

const Changes NO_CHANGES = Changes(false, false, false);

uint tile_at(uint place);
Changes work(uint tile);

// Adds those of one half of the column.
void add_changes(inout Changes changes, int half_tile, bvec4 pixels) {
    changes.any = changes.any || any(pixels);
    changes.top = changes.top || half_tile == 0 && pixels.x;
    changes.bottom = changes.bottom || half_tile == 1 && pixels.w;
}

// Returns whether there is work in a tile. A change in this very step may count, which only costs
// time.
bool awake(uint tile) {
    return WORD(step_words, steps, push.woken_at + tile) + 1u >= push.step;
}

// Returns the next place whose tile is awake, among the eight of this lane, from `n` on.
uint next_awake(uint n, uint end) {
    if (n < end) for (;;) {
        if (awake(tile_at(n))) break;
        n += TILES_PER_GROUP;
        if (n >= end) break;
    }
    return n;
}

// Marks the tile and those next to a changed pixel for the next step.
void wake(Changes changes, uint tile) {
    ivec2 own = in_rows(tile, uint(push.tiles.x));
    int column = int(gl_LocalInvocationID.x % 8u);
    int beside = int(column == TILE_PX - 1) - int(column == 0);
    [[dont_unroll]] for (int k = 0;; ++k) {
        ivec2 next = ivec2(beside * (k % 2), k / 2 - 1);
        ivec2 at = clamp(own + next, ivec2(0), ivec2(push.tiles) - 1);
        uint word = push.woken_at + uint(at.y) * push.tiles.x + uint(at.x);
        bool meant = next.y == 0 ? changes.any : next.y < 0 ? changes.top : changes.bottom;
        // Read before it is written: a word that all cores write travels between their caches.
        if (meant && WORD(step_words, steps, word) != push.step) steps.word[word] = push.step;
        if (k == 5) break;
    }
}

// Works on all places whose tiles are awake, and requests another step of `groups` workgroups if
// anything changed. Each workgroup has its own contiguous part of the places, so that adjacent
// tiles follow each other. Places are shared out in eights evenly, since a workgroup with none
// would still execute `work` once.
void take_step(uint places, uint groups) {
    uint eights = (places + TILES_PER_GROUP - 1u) / TILES_PER_GROUP;
    uint each = eights / gl_NumWorkGroups.x;
    uint more = eights % gl_NumWorkGroups.x;
    uint first = gl_WorkGroupID.x * each + min(gl_WorkGroupID.x, more);
    uint end = min(places, (first + each + uint(gl_WorkGroupID.x < more)) * TILES_PER_GROUP);
    uint n = next_awake(first * TILES_PER_GROUP + gl_LocalInvocationID.x / 8u, end);
    bool changed = false;
    if (n < end) for (;;) {
        uint tile = tile_at(n);
        Changes changes = work(tile);
        wake(changes, tile);
        changed = changed || changes.any;
        n = next_awake(n + TILES_PER_GROUP, end);
        if (n >= end) break;
    }
    if (changed && WORD(step_words, steps, 4u * push.step + 4u) == 0u) {
        steps.word[4u * push.step + 5u] = 1u;
        steps.word[4u * push.step + 6u] = 1u;
        steps.word[4u * push.step + 4u] = min(groups, push.most_groups);
    }
}
