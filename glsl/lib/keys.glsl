// Where a pixel's key lies. The includer has BEHIND, which says whether layers lie in front.
//
//     of the nearest layer     point, depth bits
//     of one behind others     depth bits behind which points are looked for, nothing, point, depth bits
// so that all a walk wants to know of a pixel lies in one texel.
const uint WORDS_A_KEY = BEHIND ? 4u : 2u;

uint point_word(uint pixel) {
    return WORDS_A_KEY * pixel + (WORDS_A_KEY - 2u);
}

uint depth_word(uint pixel) {
    return point_word(pixel) + 1u;
}
