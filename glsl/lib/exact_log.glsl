// Powers from operations with the same bits on every driver. Declares no bindings; exact_exp.glsl
// comes before.

// Returns log2 of a positive, normal number, to 2^-21 absolute: the mantissa between the roots of
// 1/2 and 2, then the series of the area tangent.
float exact_log2(float x) {
    int bits = floatBitsToInt(x);
    // 0x3F3504F3 is the root of 1/2.
    int exponent = (bits - 0x3F3504F3) >> 23;
    float mantissa = intBitsToFloat(bits - (exponent << 23));
    float s = (mantissa - 1.0) / (mantissa + 1.0);
    float q = s * s;
    return float(exponent) + s * (2.88539008 + q * (0.961796694 + q * (0.577078016 + q * 0.41219858)));
}

// Returns t^p for t >= 0, p > 0; at most 2^126 (guide: numerics, case 20).
float exact_power(float t, float p) {
    bool has = t > 1.17549435e-38;
    float power = p * exact_log2(has ? t : 1.0);
    return has ? exact_exp2(min(power, 126.0)) : 0.0;
}
