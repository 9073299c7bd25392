// Makes 256 brushes, 32 x 32 squares of coverage (dos Anjos et al. 2018, sec. 3.3.2, eq. 1).
//
//   coverage = min(1, sum of 6 to 9 super-Gaussians on a 3 x 3 grid)
//   each A e^(-(|x / sigma_x|^gamma + |y / sigma_y|^gamma) / 2), turned about its own middle
// The Gaussians of a column are turned alike, and no column by much more than the one before; the
// brush's number gives the angles. A word holds the four corners of its square, 8 bits each, so
// that a stroke reads one word per pixel. Brushes are kept while the settings stay; eight bits of a
// stroke choose one.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require

#include "exact_exp.glsl"
#include "exact_log.glsl"

layout(local_size_x = 64) in;

// 16 rotations of a whole brush, 4 from column to column; cosine and sine, made on the CPU.
layout(scalar) readonly buffer Turns { vec2 turn[]; } turns;
layout(scalar) writeonly buffer Brushes { uint word[]; } brushes;

layout(push_constant, scalar) uniform Push {
    float amplitude;
    float exponent; // of x^2 / sigma^2
    float across;   // 1 / sigma^2, of a side, along the tangent
    float along;    // and along the bitangent
    float apart;    // spacing of the grid, as a share of a side
    uint gaussians; // a bit for each
} push;

// Returns the coverage at (u, v), -1/2 to 1/2.
float coverage(vec2 at, uint number) {
    float sum = 0.0;
    vec2 turn = turns.turn[number & 15u];
    [[dont_unroll]] for (uint column = 0u; column < 3u; ++column) {
        [[dont_unroll]] for (uint r = 0u; r < 3u; ++r) {
            vec2 p = at - (vec2(column, r) - vec2(1.0)) * vec2(push.apart);
            float x = turn.x * p.x - turn.y * p.y;
            float y = turn.y * p.x + turn.x * p.y;
            float e = exact_power(x * x * push.across, push.exponent) + exact_power(y * y * push.along, push.exponent);
            // e^(-e/2)
            float g = push.amplitude * exact_exp2(e * -0.721347520);
            sum += (push.gaussians >> (3u * r + column) & 1u) == 1u ? g : 0.0;
        }
        vec2 on = turns.turn[16u + ((number >> (4u + 2u * column)) & 3u)];
        turn = vec2(turn.x * on.x - turn.y * on.y, turn.y * on.x + turn.x * on.y);
    }
    return min(sum, 1.0);
}

void main() {
    uint word = gl_GlobalInvocationID.x;
    uint number = word >> 10;
    uvec2 square = uvec2(word & 31u, word >> 5 & 31u);
    uint packed = 0u;
    [[dont_unroll]] for (uint corner = 0u; corner < 4u; ++corner) {
        vec2 at = vec2(square + uvec2(corner & 1u, corner >> 1)) / vec2(32.0) - vec2(0.5);
        packed |= uint(coverage(at, number) * 255.0 + 0.5) << (8u * corner);
    }
    brushes.word[word] = packed;
}
