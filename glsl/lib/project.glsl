// The projection of a point: the one function that decides pixels, shared by all kernels, so that
// all agree bit for bit (guide: numerics, case 25).
//
// Only + - * / and comparisons, which give the same bits on every driver (`dot`, `fma` and `mat4 *
// vec4` need not).

layout(push_constant, scalar) uniform Push {
    vec2 centre;          // pixels of the whole picture
    vec2 corner;          // pixel of the whole picture at which this strip begins
    vec2 size;            // pixels of this strip
    float near;
    uint first_chunk;
    uint chunk_count;
#ifdef MORE_TO_PUSH
    MORE_TO_PUSH
#endif
} push;

const uint CHUNKS_PER_PAGE = POINTS_PER_PAGE / POINTS_PER_CHUNK;
const uint NO_POINT = 0xFFFFFFFFu;

float row(vec4 r, vec3 d) {
    float sum = r.x * d.x + r.y * d.y + r.z * d.z + r.w;
    return sum;
}

// Returns the pixel as an index into the strip (NO_PIXEL if outside) and the depth. FARTHEST is the
// largest finite f32: overflow is outside.
const float FARTHEST = 3.402823466e38;

const uint NO_PIXEL = 0xFFFFFFFFu;

uint place(vec4 row_x, vec4 row_y, vec4 row_z, ivec3 offset, out float depth) {
    vec3 d = vec3(offset);
    depth = row(row_z, d);
    // Never divides by a depth that is rejected: drivers may assume that there is no infinity.
    float scale = PERSPECTIVE ? 1.0 / (depth >= push.near ? depth : 1.0) : 1.0;
    // In the whole picture first, whatever part of it this is: the offset subtracted after that is
    // an integer, which rounds nothing.
    float x = row(row_x, d) * scale + push.centre.x - push.corner.x;
    float y = row(row_y, d) * scale + push.centre.y - push.corner.y;
    // Tested as floats before converting: NaN and infinity fail, and (-1, 0) does not truncate into
    // column 0 (guide: numerics, case 1).
    bool inside = depth >= push.near && depth <= FARTHEST && x >= 0.0 && x < push.size.x && y >= 0.0 && y < push.size.y;
    return inside ? uint(y) * uint(push.size.x) + uint(x) : NO_PIXEL;
}
