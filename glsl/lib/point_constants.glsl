// Constants of every way of projecting.

// One SIMD on a software device, a few on a GPU (PROBE.md).
layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint LANES = 8u;
// Position planes to read: 10, 20 or 30 bits an axis.
layout(constant_id = 1) const uint PLANES = 1u;
layout(constant_id = 2) const bool PERSPECTIVE = true;
// Texel buffers are large enough. lavapipe gathers texels, and loads from storage buffers lane by lane, several times slower.
layout(constant_id = 4) const bool TEXELS = true;
// Which points are not there: those whose opacity is 0, where they have brought their kinds (1); those that face away from the camera, where they have brought their normals (2); those that clip boxes leave out (4); or several of these.
layout(constant_id = 6) const uint FILTERED = 0u;
const bool BY_OPACITY = (FILTERED & 1u) != 0u;
const bool ONE_SIDED = (FILTERED & 2u) != 0u;
const bool CLIPPED = (FILTERED & 4u) != 0u;
// As in config.rs.
layout(constant_id = 3) const uint POINTS_PER_CHUNK = 4096u;
