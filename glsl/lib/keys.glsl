// The layout of keys. The includer has BEHIND, which tells whether layers lie in front.
//
//     nearest layer         point, depth bits
//     layer behind others   depth bits behind which points are looked for, nothing, point, depth bits
// so that a walk reads all about a pixel in one texel.
const uint WORDS_A_KEY = BEHIND ? 4u : 2u;

uint point_word(uint pixel) {
    return WORDS_A_KEY * pixel + (WORDS_A_KEY - 2u);
}

uint depth_word(uint pixel) {
    return point_word(pixel) + 1u;
}
