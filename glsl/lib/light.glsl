// What light_fill and light_limit share: how far behind the light's depth a point is still of the same layer. Declares no bindings.

layout(constant_id = 0) const bool PERSPECTIVE = false;

layout(push_constant, scalar) uniform Push {
    uvec2 size;     // texels
    float texel;    // side of a texel: metres, or with perspective parts of the depth
    float layer;    // across a surface: metres,
    float layer_px; // and texels' sides
    float steepest; // tangent of the angle to the light beyond which a surface counts as no steeper
    float filled;   // steps of filling so far
} push;

float texel_at(float z) {
    return PERSPECTIVE ? z * push.texel : push.texel;
}

float layer_at(float z) {
    return push.layer + push.layer_px * texel_at(z);
}

// Of a layer across a surface, along the light: layer / <v, n>, by the tangent of the angle between them.
float along_light(float layer, float tangent) {
    return layer * sqrt(1.0 + tangent * tangent);
}

// Tangent of the angle at which a surface rises by so much from a texel to another; 0 where it would be so steep that they are of two surfaces. A depth may be a whole texel's fall too great, so that is
// only beyond 1 + sqrt(2) times the steepest slope.
float tangent_of(float rise, float run) {
    float tangent = abs(rise) / run;
    return tangent <= 2.41421356 * push.steepest ? tangent : 0.0;
}

// How far apart a texel and a neighbour are, by the neighbour's number.
float run_to(int neighbour, float texel) {
    return neighbour % 2 == 0 ? 1.41421356 * texel : texel;
}

// Once around a texel.
const ivec2 RING[8] = ivec2[8](ivec2(-1, -1), ivec2(0, -1), ivec2(1, -1), ivec2(1, 0), ivec2(1, 1), ivec2(0, 1), ivec2(-1, 1), ivec2(-1, 0));
