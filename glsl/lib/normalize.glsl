// A vector's direction, whatever its length. Declares no bindings.

// 0 where there is none. Divided by its largest part first, so that no square is too large or too small.
vec3 unit(vec3 v) {
    float largest = max(max(abs(v.x), abs(v.y)), abs(v.z));
    bool has = largest > 0.0;
    vec3 near = v / vec3(mix(1.0, largest, has));
    float square = near.x * near.x + near.y * near.y + near.z * near.z;
    return near / vec3(sqrt(mix(1.0, square, has)));
}
