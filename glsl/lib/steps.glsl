// Steps from one image into another until nothing changes: which tiles a step works on, and whether there is another. Declares no bindings.
//
// A tile in whose neighbourhood nothing changed in the step before is left alone: both images hold the same there. `steps` is four words a step: three of the
// dispatch, which is empty when nothing changed in the step before, and one spare; then for every tile the last step that changed it.
//
// The includer has `steps`, bound as `step_words`, too, and in `push`: `tiles`, across and down; `step`, from 1; `changed_at`, the first tile's word; `most_groups` of a dispatch.

// Whether anything around a tile changed in the step before.
bool awake(uint tile) {
    bool changed = push.step == 1u;
    ivec2 own = ivec2(tile % push.tiles.x, tile / push.tiles.x);
    [[dont_unroll]] for (int k = 0;; ++k) {
        ivec2 at = clamp(own + ivec2(k % 3, k / 3) - 1, ivec2(0), ivec2(push.tiles) - 1);
        // A neighbour may be changing right now: then it is taken for changed, which costs time and nothing else.
        changed = changed || WORD(step_words, steps, push.changed_at + uint(at.y) * push.tiles.x + uint(at.x)) + 1u >= push.step;
        if (changed || k == 8) break;
    }
    return changed;
}

// That this step changed a tile, and so there is another, of so many workgroups.
void record_change(uint tile, uint groups) {
    if (WORD(step_words, steps, push.changed_at + tile) != push.step) steps.word[push.changed_at + tile] = push.step;
    // Looked at before it is written: a word that all cores write travels between their caches.
    if (WORD(step_words, steps, 4u * push.step + 4u) == 0u) {
        steps.word[4u * push.step + 5u] = 1u;
        steps.word[4u * push.step + 6u] = 1u;
        steps.word[4u * push.step + 4u] = min(groups, push.most_groups);
    }
}
