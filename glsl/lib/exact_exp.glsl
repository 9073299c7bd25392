// Elementary functions from operations with the same bits on every driver (+ - * and integers).
// Declares no bindings.

// Returns 2^x for x <= 0, to 2^-22 relative; 0 below -126. The polynomial is the Taylor series of
// 2^f on [-1/2, 1/2].
float exact_exp2(float x) {
    float clamped = max(x, -126.0);
    float whole = floor(clamped + 0.5);
    float f = (clamped - whole) * 0.693147180559945;
    float p = 1.0 + f * (1.0 + f * (0.5 + f * (0.166666667 + f * (0.0416666667 + f * (0.00833333333 + f * 0.00138888889)))));
    float scaled = p * intBitsToFloat((int(whole) + 127) << 23);
    return x < -126.0 ? 0.0 : scaled;
}
