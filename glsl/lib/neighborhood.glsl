// Depths of a pixel and its neighbours, from images with four rows per texel. Declares no bindings.

#define NO_DEPTH uintBitsToFloat(BACKGROUND_BITS)

// Returns the depth, or NO_DEPTH if it is unknown or outside of the image.
float depth_or_none(float z) {
    return mix(NO_DEPTH, z, floatBitsToUint(z) - 1u < BACKGROUND_BITS - 1u);
}

// Loads the four pixels of a texel, a column, and their neighbours, row by row, three to a row.
#define LOAD_AROUND(z, image, texel) \
    [[unroll]] for (int k = 0; k < 3; ++k) { \
        ivec2 at = (texel) + ivec2(k - 1, 0); \
        vec4 own = imageLoad(image, at); \
        z[k] = depth_or_none(imageLoad(image, at - ivec2(0, 1)).w); \
        [[unroll]] for (int p = 0; p < 4; ++p) z[3 * p + 3 + k] = depth_or_none(own[p]); \
        z[15 + k] = depth_or_none(imageLoad(image, at + ivec2(0, 1)).x); \
    }
