// Constants of every kernel that walks over points.

// One SIMD vector on a software device, a few on a GPU.
layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint LANES = 8u;
// Position planes to read: 10, 20 or 30 bits per axis.
layout(constant_id = 1) const uint PLANES = 1u;
layout(constant_id = 2) const bool PERSPECTIVE = true;
// True if texel buffers are large enough. lavapipe gathers texels, but loads from storage buffers
// lane by lane, several times slower.
layout(constant_id = 4) const bool TEXELS = true;
// Points to leave out: of opacity 0, if kinds are known (1); facing away from the camera, if
// normals are known (2); by clip boxes (4); or several of these.
layout(constant_id = 6) const uint FILTERED = 0u;
const bool BY_OPACITY = (FILTERED & 1u) != 0u;
const bool ONE_SIDED = (FILTERED & 2u) != 0u;
const bool CLIPPED = (FILTERED & 4u) != 0u;
// Equal to that in config.rs.
layout(constant_id = 3) const uint POINTS_PER_CHUNK = 4096u;
