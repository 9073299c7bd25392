// A stroke in a pixel. The includer has `brushes` and `brush_words`.

// Where a pixel's ray meets a stroke's square: (u, v) in shares of its sides, whether that is on
// it, and the inputs of its depth.
struct Met {
    vec2 uv;
    float turned;
    float over;
    bool is_on;
};

Met meet(vec2 at, vec4 centre_turning, vec4 axes, vec2 reach) {
    vec2 off = at - centre_turning.xy;
    float turned = centre_turning.z * off.x + centre_turning.w * off.y;
    // Not behind the plane's horizon.
    bool met = !PERSPECTIVE || turned > -1.0;
    float over = PERSPECTIVE ? 1.0 / (met ? 1.0 + turned : 1.0) : 1.0;
    vec2 uv = vec2(axes.x * off.x + axes.y * off.y, axes.z * off.x + axes.w * off.y) * vec2(over);
    return Met(uv, turned, over, met && abs(uv.x) <= reach.x && abs(uv.y) <= reach.y);
}

// Returns the depth, for the depth of the stroke's point.
float depth_of(Met met, float depth) {
    return PERSPECTIVE ? depth * met.over : depth - met.turned;
}

// Returns the coverage of a brush at (u, v), -1/2 to 1/2, beyond which it is 0: interpolated
// between the corners of one of its 32 x 32 squares.
float coverage(vec2 at, uint brush) {
    vec2 place = clamp((at + vec2(0.5)) * vec2(32.0), vec2(0.0), vec2(32.0));
    uvec2 square = min(uvec2(place), uvec2(31u));
    vec2 f = place - vec2(square);
    uint word = WORD(brushes, brush_words, brush << 10 | square.y << 5 | square.x);
    float upper = float(word & 255u) * (1.0 - f.x) + float(word >> 8 & 255u) * f.x;
    float lower = float(word >> 16 & 255u) * (1.0 - f.x) + float(word >> 24) * f.x;
    bool inside = abs(at.x) <= 0.5 && abs(at.y) <= 0.5;
    return inside ? (upper * (1.0 - f.y) + lower * f.y) / 255.0 : 0.0;
}

// Returns the coverage of the second layer of small clusters, a smaller stroke across the first.
float second_coverage(vec2 uv, uint brush) {
    return coverage(vec2(-uv.y, uv.x) * vec2(1.5), brush ^ 0xA5u);
}
