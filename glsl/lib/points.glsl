// Constants of every way of projecting.

// One SIMD on a software device, a few on a GPU (PROBE.md).
layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint LANES = 8u;
// Position planes to read: 10, 20 or 30 bits an axis.
layout(constant_id = 1) const uint PLANES = 1u;
layout(constant_id = 2) const bool PERSPECTIVE = true;
// Texel buffers are large enough. lavapipe gathers texels, and loads from storage buffers lane by lane, several times slower.
layout(constant_id = 4) const bool TEXELS = true;
// Points whose opacity is 0 are not there; they have brought their kinds.
layout(constant_id = 6) const bool FILTERED = false;
// As in config.rs.
layout(constant_id = 3) const uint POINTS_PER_CHUNK = 4096u;
