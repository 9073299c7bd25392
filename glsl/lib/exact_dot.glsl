// Sums of products that give the same bits on every driver, which `dot` need not. Declares no bindings.

#ifndef DOT
#define DOT

float dot_of(vec3 a, vec3 b) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

#endif
