// Ground (stroke_quads) -> mask of surfaces.
//
//   Near its own point a stroke lies on its surface. Farther out it does if, in some of eight
//   directions (surface.rs), near ground is within a few pixels: in a gap between strokes, but not
//   beyond an outline or in a notch.
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require

layout(local_size_x = 64) in;

// Two words per pixel, for a strip and its surroundings: not 0 on far ground and on near ground of
// a stroke.
layout(scalar) readonly buffer Ground { uint word[]; } ground;
layout(scalar) writeonly buffer Surface { uint word[]; } surface;

layout(push_constant, scalar) uniform Push {
    uint width;    // pixels of the strip
    uint enclosed; // search radius of near ground [px], and border of the strip
    uint directions; // of eight, where it must be found
} push;

void main() {
    if (gl_GlobalInvocationID.x >= push.width) return;
    uint width = push.width + 2u * push.enclosed;
    uint own = (gl_GlobalInvocationID.y + push.enclosed) * width + gl_GlobalInvocationID.x + push.enclosed;
    bool is_surface = ground.word[2u * own + 1u] != 0u;
    // A loop, because software devices execute branches that no lane takes.
    for (bool todo = !is_surface && ground.word[2u * own] != 0u; todo; todo = false) {
        uint directions = 0u;
        // Step 0 is the pixel itself, which is not near.
        [[unroll]] for (int way = 0; way < 9; ++way) {
            int step = (way / 3 - 1) * int(width) + way % 3 - 1;
            uint near = 0u;
            for (uint k = 1u; k <= push.enclosed; ++k) near |= ground.word[2 * (int(own) + int(k) * step) + 1];
            directions += near;
        }
        is_surface = directions >= push.directions;
    }
    surface.word[gl_GlobalInvocationID.y * push.width + gl_GlobalInvocationID.x] = is_surface ? 1u : 0u;
}
