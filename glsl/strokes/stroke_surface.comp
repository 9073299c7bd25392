// Ground, as stroke_quads leaves it -> of every pixel whether a surface is there.
//
//   near its own point a stroke lies on its surface
//   farther out it does where, in some of eight directions (ground.rs), near ground is no farther than so many pixels: in a gap between strokes, not beyond an outline, nor in a notch
#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require

layout(local_size_x = 64) in;

// Two words a pixel, of a band and of what is around it: not 0 where a stroke's far ground is, and where its near ground is.
layout(scalar) readonly buffer Ground { uint word[]; } ground;
layout(scalar) writeonly buffer Surface { uint word[]; } surface;

layout(push_constant, scalar) uniform Push {
    uint width;    // of the band, pixels
    uint enclosed; // how far near ground is looked for, pixels, and how many are around the band
    uint directions; // of eight, in which it is to be found
} push;

void main() {
    if (gl_GlobalInvocationID.x >= push.width) return;
    uint width = push.width + 2u * push.enclosed;
    uint own = (gl_GlobalInvocationID.y + push.enclosed) * width + gl_GlobalInvocationID.x + push.enclosed;
    bool is_surface = ground.word[2u * own + 1u] != 0u;
    // A loop, because software devices walk through branches that no lane takes.
    for (bool todo = !is_surface && ground.word[2u * own] != 0u; todo; todo = false) {
        uint directions = 0u;
        // That of no step is the pixel itself, which is not near.
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
