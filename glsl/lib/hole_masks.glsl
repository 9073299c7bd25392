// The eight masks: five consecutive pixels of the ring of eight around one, in all rotations
// (Dobrev et al. 2010, sec. 3.2). Declares no bindings.

// Returns whether five adjacent bits of a ring of eight are set.
bool any_mask(uint ring) {
    uint twice = ring | ring << 8;
    uint two = twice & twice >> 1;
    uint four = two & two >> 2;
    return (four & twice >> 4 & 255u) != 0u;
}
