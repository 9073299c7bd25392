// Dot products with the same bits on every driver, unlike `dot`. Declares no bindings.

#ifndef DOT
#define DOT

float dot_of(vec3 a, vec3 b) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

#endif
