// Tangents of a unit normal, along which strokes are painted (dos Anjos et al. 2018, sec. 3.3.1).
// The includer has exact_dot.glsl. Declares no bindings.
//
// The cross product of normal and tangent is the bitangent.

const uint HOUSEHOLDER = 0u;
const uint EBERLY = 1u;
const uint SQUAREPLATE = 2u;
const uint COVARIANCE = 3u;

vec3 cross_of(vec3 a, vec3 b) {
    return vec3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}

// Returns the second column of the reflection that takes the normal to the first axis (guide:
// numerics, case 19). Smooth everywhere but at (-1, 0, 0).
vec3 householder(vec3 n) {
    float lateral = n.y * n.y + n.z * n.z;
    bool pole = n.x < 0.0 && lateral == 0.0;
    float h = n.x >= 0.0 ? 1.0 + n.x : lateral / (1.0 - n.x);
    h = pole ? 1.0 : h;
    return pole ? vec3(0.0, 1.0, 0.0) : vec3(-n.y, 1.0 - n.y * n.y / h, -n.y * n.z / h);
}

// Returns the cross product with whichever of two axes is farther from the normal (Eberly 2016).
vec3 eberly(vec3 n) {
    bool x = abs(n.x) > abs(n.y);
    vec3 aside = x ? vec3(-n.z, 0.0, n.x) : vec3(0.0, n.z, -n.y);
    return aside / vec3(sqrt(dot_of(aside, aside)));
}

// Returns the cross product with the normal with rotated components, as a plate turned about its
// diagonal; for normals that this leaves unchanged there is a special case. Near those all
// components are nearly alike, where products would cancel; their differences are exact.
vec3 squareplate(vec3 n) {
    vec3 p = n.xyz - n.zxy;
    vec3 q = n.yzx - n.zxy;
    vec3 aside = n.zxy * (p + q) + p * q;
    float square = dot_of(aside, aside);
    vec3 other = vec3(n.y, -n.x, 0.0);
    bool plate = square > 1e-6;
    aside = plate ? aside : other;
    square = plate ? square : dot_of(other, other);
    return aside / vec3(sqrt(square));
}

// Returns a tangent by one of the methods that need only a normal.
vec3 tangent_of(uint way, vec3 n) {
    vec3 tangent = householder(n);
    if (way == EBERLY) tangent = eberly(n);
    if (way == SQUAREPLATE) tangent = squareplate(n);
    return tangent;
}

// Returns the tangent turned about the normal by this cosine and sine.
vec3 turned(vec3 n, vec2 turn) {
    vec3 own = householder(n);
    return own * vec3(turn.x) + cross_of(n, own) * vec3(turn.y);
}
