// Depth that light reaches in each texel of its picture. The includer has TEXELS.

// f32 bits, row by row; as texels, and as words if texel buffers are too small.
layout(r32ui) readonly uniform uimageBuffer limit;
layout(scalar) readonly buffer LimitWords { float word[]; } limit_words;

float limit_at(uint texel) {
    return TEXELS ? uintBitsToFloat(imageLoad(limit, int(texel)).r) : limit_words.word[texel];
}
