// A word of a buffer that is bound twice: as texels, which lavapipe gathers, while it loads words
// one lane at a time; and as words for devices whose texel buffers are too small.
#define WORD_OF(texels, words, i) (TEXELS ? imageLoad(texels, int(i)).r : words[i])
#define WORD(texels, words, i) WORD_OF(texels, words.word, i)
