// Depth as a host stores it. The including file has `far`, the host's depth of what is infinitely
// far.

// 0: no depth. 1: a + b / z. 2: a + b z.
layout(constant_id = 1) const uint DEPTH = 0;

bool is_known(float z) {
    return z > 0.0 && !isinf(z);
}

float host_depth(float z, vec2 form, float far) {
    float stored = DEPTH == 1 ? form.x + form.y / z : form.x + form.y * z;
    return is_known(z) ? clamp(stored, 0.0, 1.0) : far;
}
