// Direction of a vector of any length. Declares no bindings.

// Returns 0 for the zero vector. Divides by the largest component first, so that squares neither
// overflow nor vanish.
vec3 unit(vec3 v) {
    float largest = max(max(abs(v.x), abs(v.y)), abs(v.z));
    bool has = largest > 0.0;
    vec3 near = v / vec3(mix(1.0, largest, has));
    float square = near.x * near.x + near.y * near.y + near.z * near.z;
    return near / vec3(sqrt(mix(1.0, square, has)));
}
