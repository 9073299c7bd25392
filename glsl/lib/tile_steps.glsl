// Steps from one image into another until nothing changes: which tiles a step works on, and whether there is another. Declares no bindings.
//
// A tile is left alone where nothing changed in the step before, neither in it nor next to it: both images hold the same there. `steps` is four words a step: three of the dispatch, which is empty when
// nothing changed in the step before, and one spare; then for every tile the last step that changed a pixel of it, or next to it.
//
// The includer has `steps`, bound as `step_words`, too, and in `push`: `tiles`, across and down; `step`, from 1; `woken_at`, the first tile's word; `most_groups` of a dispatch. It says which tile is at a
// place of those that there are, and works on a lane's column of a tile.

// Pixels of a lane's column that a step changed: any, that at its top, that at its bottom.
struct Changes {
    bool any;
    bool top;
    bool bottom;
};

const Changes NO_CHANGES = Changes(false, false, false);

uint tile_at(uint place);
Changes work(uint tile);

// Those of a half of the column.
void add_changes(inout Changes changes, int half_tile, bvec4 pixels) {
    changes.any = changes.any || any(pixels);
    changes.top = changes.top || half_tile == 0 && pixels.x;
    changes.bottom = changes.bottom || half_tile == 1 && pixels.w;
}

// Whether there is anything to do in a tile. Where something changes right now, that is taken for yes, which costs time and nothing else.
bool awake(uint tile) {
    return WORD(step_words, steps, push.woken_at + tile) + 1u >= push.step;
}

// The next place whose tile is awake, of those of this lane's eight, from `n` on.
uint next_awake(uint n, uint end) {
    if (n < end) for (;;) {
        if (awake(tile_at(n))) break;
        n += TILES_PER_GROUP;
        if (n >= end) break;
    }
    return n;
}

// That the tile and those next to a changed pixel are to be looked at in the next step.
void wake(Changes changes, uint tile) {
    ivec2 own = in_rows(tile, uint(push.tiles.x));
    int column = int(gl_LocalInvocationID.x % 8u);
    int beside = int(column == TILE_PX - 1) - int(column == 0);
    [[dont_unroll]] for (int k = 0;; ++k) {
        ivec2 next = ivec2(beside * (k % 2), k / 2 - 1);
        ivec2 at = clamp(own + next, ivec2(0), ivec2(push.tiles) - 1);
        uint word = push.woken_at + uint(at.y) * push.tiles.x + uint(at.x);
        bool meant = next.y == 0 ? changes.any : next.y < 0 ? changes.top : changes.bottom;
        // Looked at before it is written: a word that all cores write travels between their caches.
        if (meant && WORD(step_words, steps, word) != push.step) steps.word[word] = push.step;
        if (k == 5) break;
    }
}

// Works on all places whose tiles are awake, and asks for another step, of so many workgroups, where anything changed. Each workgroup has its own part of the places, from end to end, so that tiles side
// by side follow each other; eights of places are shared out evenly, since one that has none would walk through `work` once all the same.
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
