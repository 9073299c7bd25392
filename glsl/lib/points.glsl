// Constants of every way of projecting.

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint LANES = 8u;
// Position planes to read: 10, 20 or 30 bits an axis.
layout(constant_id = 1) const uint PLANES = 1u;
layout(constant_id = 2) const bool PERSPECTIVE = true;
// Reads the key before the atomic and skips it where the point loses anyway: gains on GPUs, loses on lavapipe (measured).
layout(constant_id = 3) const bool EARLY_READ = false;
