// Steps from one image into another until nothing changes: which tiles a step works on, and whether there is another. Declares no bindings.
//
// A tile is left alone where nothing changed in the step before, neither in it nor next to it: both images hold the same there. `steps` is four words a step: three of the dispatch, which is empty when
// nothing changed in the step before, and one spare; then for every tile the last step that changed a pixel of it, or next to it.
//
// The includer has `steps`, bound as `step_words`, too, and in `push`: `tiles`, across and down; `step`, from 1; `woken_at`, the first tile's word; `most_groups` of a dispatch.

// Whether there is anything to do in a tile. Where something changes right now, that is taken for yes, which costs time and nothing else.
bool awake(uint tile) {
    return push.step == 1u || WORD(step_words, steps, push.woken_at + tile) + 1u >= push.step;
}

// Pixels of a lane's column that a step changed: any, that at its top, that at its bottom.
struct Changes {
    bool any;
    bool top;
    bool bottom;
};

const Changes NO_CHANGES = Changes(false, false, false);

// Those of a half of the column.
void add_changes(inout Changes changes, int half_tile, bvec4 pixels) {
    changes.any = changes.any || any(pixels);
    changes.top = changes.top || half_tile == 0 && pixels.x;
    changes.bottom = changes.bottom || half_tile == 1 && pixels.w;
}

// That the tile and those next to a changed pixel are to be looked at in the next step, and that there is one, of so many workgroups.
void record_changes(Changes changes, uint tile, uint groups) {
    if (!changes.any) return;
    ivec2 own = in_rows(tile, uint(push.tiles.x));
    int column = int(gl_LocalInvocationID.x % 8u);
    int beside = int(column == TILE_PX - 1) - int(column == 0);
    [[dont_unroll]] for (int k = 0;; ++k) {
        ivec2 next = ivec2(beside * (k % 2), k / 2 - 1);
        ivec2 at = clamp(own + next, ivec2(0), ivec2(push.tiles) - 1);
        uint word = push.woken_at + uint(at.y) * push.tiles.x + uint(at.x);
        bool meant = next.y == 0 || (next.y < 0 ? changes.top : changes.bottom);
        // Looked at before it is written: a word that all cores write travels between their caches.
        if (meant && WORD(step_words, steps, word) != push.step) steps.word[word] = push.step;
        if (k == 5) break;
    }
    if (WORD(step_words, steps, 4u * push.step + 4u) == 0u) {
        steps.word[4u * push.step + 5u] = 1u;
        steps.word[4u * push.step + 6u] = 1u;
        steps.word[4u * push.step + 4u] = min(groups, push.most_groups);
    }
}
