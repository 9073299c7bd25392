// Point clouds drawn into a Vulkan application's images: docs in the guide, "embedding".
//
// Structs begin with their size, which their _default function sets: as many bytes as this header
// knows, so that older hosts run with newer libraries. Every function returns a PointillistResult; on
// failure, outputs are as they were, and `error`, which may be NULL, has a message. Handles are cast
// to uint64_t. A renderer is used by one thread at a time.

#ifndef POINTILLIST_H
#define POINTILLIST_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

// Version of this interface: functions and members are only added while it is the same.
#define POINTILLIST_VERSION 1

// Outcome of a function.
typedef enum PointillistResult {
  // Success.
  POINTILLIST_RESULT_OK = 0,
  // A request makes no sense: null, a wrong number, an unknown name.
  POINTILLIST_RESULT_REQUEST = 1,
  // A file cannot be read, or does not follow its format.
  POINTILLIST_RESULT_FILE = 2,
  // The device lacks something, or its memory is exhausted.
  POINTILLIST_RESULT_DEVICE = 3,
  // The device is lost; the renderer can only be restored on another one, or freed.
  POINTILLIST_RESULT_DEVICE_LOST = 4,
  // A fault of pointillist; the renderer can only be freed.
  POINTILLIST_RESULT_PANIC = 5,
} PointillistResult;

// State of a cloud.
typedef enum PointillistCloudState {
  // Files are being read, or points copied and prepared.
  POINTILLIST_CLOUD_STATE_LOADING = 0,
  // Points are being uploaded, some with each frame.
  POINTILLIST_CLOUD_STATE_UPLOADING = 1,
  // The cloud is drawn; of an index, nodes still come and go.
  POINTILLIST_CLOUD_STATE_READY = 2,
  // The files cannot be read, or memory is exhausted.
  POINTILLIST_CLOUD_STATE_FAILED = 3,
} PointillistCloudState;

// Where a camera looks from.
typedef enum PointillistPreset {
  // View from above, north up, without perspective.
  POINTILLIST_PRESET_TOP = 0,
  // View from the south, without perspective.
  POINTILLIST_PRESET_FRONT = 1,
  // View from the east, without perspective.
  POINTILLIST_PRESET_SIDE = 2,
  // View from a corner, without perspective.
  POINTILLIST_PRESET_ISO = 3,
  // Oblique, with perspective, near enough to fill the picture.
  POINTILLIST_PRESET_FIT = 4,
} PointillistPreset;

// A renderer.
typedef struct PointillistRenderer PointillistRenderer;

// A device feature that drawing needs, or uses if it is enabled. Text is UTF-8 and ends with 0.
typedef struct PointillistRequirement {
  // Bytes of this struct.
  size_t size;
  // 1 if nothing works without it.
  bool required;
  // Vulkan structure that has the member.
  char structure[64];
  // Name of the member, such as synchronization2.
  char feature[64];
  // What it is for.
  char purpose[256];
} PointillistRequirement;

// Message of a failure: UTF-8, ends with 0.
typedef struct PointillistError {
  // The message, cut if longer.
  char message[1024];
} PointillistError;

// The host's Vulkan objects; handles are cast to integers.
typedef struct PointillistHost {
  // Bytes of this struct, as its `_init` function sets them.
  size_t size;
  // Address of vkGetInstanceProcAddr.
  const void *get_instance_proc_addr;
  // VkInstance.
  uint64_t instance;
  // VkPhysicalDevice.
  uint64_t physical_device;
  // VkDevice.
  uint64_t device;
  // Family of the command buffers, with graphics and compute.
  uint32_t queue_family;
  // 1 if shaderInt64 and shaderBufferInt64Atomics are enabled, else 0, as all of its kind.
  uint8_t has_int64_atomics;
  // 1 if the instance has VK_EXT_debug_utils.
  uint8_t has_debug_utils;
  // Device memory for nodes of indexes, which share it equally, in bytes; 0 is the default.
  uint64_t memory_budget;
  // Most points drawn of an index; 0 is automatic.
  uint64_t point_budget;
  // VkAllocationCallbacks for the CPU memory of all objects that are made here, on any thread,
  // or null. They are copied. Device memory is allocated without them.
  const void *allocation_callbacks;
  // Function that is called, on any thread, in place of vkAllocateMemory, for blocks of many
  // buffers and images; null if there is none. It may refuse with
  // VK_ERROR_OUT_OF_DEVICE_MEMORY.
  const void *allocate_memory;
  // Function that is called in place of vkFreeMemory, on any thread; null if there is none. It
  // is given if and only if `allocate_memory` is.
  const void *free_memory;
} PointillistHost;

// Points of the host's memory; arrays that are null are absent.
typedef struct PointillistPoints {
  // Bytes of this struct.
  size_t size;
  // Number of points.
  size_t count;
  // x, y, z of each point; give these, those in f32, or steps.
  const double *positions_f64;
  // The same in f32.
  const float *positions_f32;
  // Red, green, blue of each point, sRGB.
  const uint8_t *colors;
  // Intensity of each point.
  const float *intensities;
  // ASPRS class of each point.
  const uint8_t *classes;
  // x, y, z of each point as steps of a lattice, kept as they are: offset + scale * step.
  const int32_t *steps;
  // Width of a step along each axis.
  double scale[3];
  // Position of step 0.
  double offset[3];
} PointillistPoints;

// Points in a buffer of the host's device; see `pointillist_add_buffer`.
typedef struct PointillistPointBuffer {
  // Bytes of this struct.
  size_t size;
  // VkBuffer, with VK_BUFFER_USAGE_TRANSFER_SRC_BIT.
  uint64_t buffer;
  // Byte of the first point, a multiple of 4.
  uint64_t offset;
  // Bytes from point to point, a multiple of 4. A point begins with x, y and z, f32.
  uint32_t stride;
  // Number of points.
  uint32_t count;
  // Byte of red, green and blue within a point, sRGB; UINT32_MAX if there are no colours.
  uint32_t color_offset;
} PointillistPointBuffer;

// A view: matrices column by column, in Vulkan's clip space, and its area in the targets.
typedef struct PointillistView {
  // Bytes of this struct.
  size_t size;
  // From the world to the view.
  double view[16];
  // From the view to clip space.
  double projection[16];
  // Left pixel of the area, which lies within the targets.
  int32_t x;
  // Top pixel of the area.
  int32_t y;
  // Pixels of each row.
  uint32_t width;
  // Rows.
  uint32_t height;
} PointillistView;

// How an image was used, or will be: Vulkan's numbers. With a transfer of ownership between queue
// families, the host records the other half of each barrier: before the frame a release from
// `before.layout` to COLOR_ATTACHMENT_OPTIMAL (of depth: DEPTH_STENCIL_ATTACHMENT_OPTIMAL), after
// it an acquisition from there to `after.layout`.
typedef struct PointillistAccess {
  // VkImageLayout.
  int32_t layout;
  // Queue family that owns the image; UINT32_MAX if it is the renderer's.
  uint32_t family;
  // VkPipelineStageFlags2.
  uint64_t stages;
  // VkAccessFlags2.
  uint64_t access;
} PointillistAccess;

// An image of the host to draw into: one layer, one level, one sample.
typedef struct PointillistTarget {
  // Bytes of this struct.
  size_t size;
  // VkImage.
  uint64_t image;
  // VkImageView.
  uint64_t view;
  // VkFormat.
  int32_t format;
  // Width of the image, in pixels.
  uint32_t width;
  // Height of the image, in pixels.
  uint32_t height;
  // Samples of each pixel, 1: others are refused.
  uint32_t samples;
  // Last access before.
  struct PointillistAccess before;
  // First access afterwards.
  struct PointillistAccess after;
  // 1 if the area is cleared first: colour to the background, depth to what is farthest.
  uint8_t clear;
} PointillistTarget;

// A frame.
typedef struct PointillistFrame {
  // Bytes of this struct.
  size_t size;
  // Grows from frame to frame, from 1.
  uint64_t number;
  // Last frame that the device has completed; 0 if none.
  uint64_t safe;
  // Colours that are drawn.
  const struct PointillistTarget *color;
  // Depth that points are hidden by; null if there is none.
  const struct PointillistTarget *depth;
  // 1 if points' depth is written.
  uint8_t writes_depth;
  // 1 if colours are stored linear instead of encoded.
  uint8_t linear;
  // Views, one after another.
  const struct PointillistView *views;
  // Number of views.
  size_t view_count;
  // Ids of the points that are seen, VK_FORMAT_R32_UINT, or R32G32_UINT with the cloud as the
  // second; null if not wanted.
  const struct PointillistTarget *ids;
  // Normals of the visible surface, world; null if not wanted.
  const struct PointillistTarget *normals;
  // 1 if the depth image has the usages of a source and a destination of transfers. Then the
  // host's geometry hides each layer of translucent points by itself, and several clouds hide
  // each other even if their depth is not written.
  uint8_t copies_depth;
} PointillistFrame;

// What a frame shows.
typedef struct PointillistReport {
  // Bytes of this struct.
  size_t size;
  // Points drawn in all views.
  uint64_t points;
  // Nodes that are missing, or coarser than the views call for.
  uint64_t missing;
  // Data of clouds that has come to the device since the last frame, in bytes: at most
  // 32 MiB of files and points, and as much of indexes.
  uint64_t streamed;
  // Number of clouds or nodes that could not be drawn.
  uint64_t errors;
  // 1 if everything that the views call for is drawn.
  bool settled;
} PointillistReport;

// Answer to a pick.
typedef struct PointillistPicked {
  // Bytes of this struct.
  size_t size;
  // 1 if there is an answer; if not, ask again after another frame.
  bool answered;
  // 1 if a point was met; the rest is undefined if not.
  bool met;
  // 1 if the position is the file's own, to the last bit.
  bool exact;
  // Cloud of the point.
  uint64_t cloud;
  // In the host's world.
  double world[3];
  // In the cloud's own coordinates.
  double position[3];
  // Number of the point, as the ids of its frame have it; UINT32_MAX if it is no single one.
  uint32_t id;
  // ASPRS class of that point, 0 if it has none; -1 if there is no single point.
  int32_t class_code;
  // Number of its return, 0 if it has none; -1 if there is no single point.
  int32_t return_number;
  // Name of the file or station that it is from: UTF-8, ends with 0, cut if longer.
  char station[256];
  // Colour that it is drawn with before lighting and exposure: 8-bit sRGB, and 255; all 0 if
  // there is no single point.
  uint8_t color[4];
  // Number that it is coloured by: its intensity, class or source as in the file; its elevation
  // `[m]`, time `[s]` or scalar within 1/65,535 of the cloud's range. NaN if there is none.
  double value;
  // Planar depth `[m]`: in the cloud's units, or in the world's if its transform is no
  // similarity.
  double depth;
} PointillistPicked;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// Returns the version of the library's interface, to be compared with POINTILLIST_VERSION.
uint32_t pointillist_version(void);

// Returns the number of requirements.
uint32_t pointillist_requirement_count(void);

// Returns a feature that a device must have, or that makes it faster, from 0 on. No extension is
// needed beside Vulkan 1.3.
enum PointillistResult pointillist_requirement(uint32_t number,
                                               struct PointillistRequirement *out,
                                               struct PointillistError *error);

// Checks a physical device, before the host creates its device.
enum PointillistResult pointillist_check(const void *get_instance_proc_addr,
                                         uint64_t instance,
                                         uint64_t physical_device,
                                         struct PointillistError *error);

// Enables what is required in a chain of VkPhysicalDeviceFeatures2 and structures that follow it:
// VkPhysicalDeviceVulkan12Features and VkPhysicalDeviceVulkan13Features, or those of single
// features. With `optional`, also what is optional, which the device must have.
enum PointillistResult pointillist_enable_features(void *chain,
                                                   uint8_t optional,
                                                   struct PointillistError *error);

// Creates a renderer on the host's device, which must outlive it.
enum PointillistResult pointillist_new(const struct PointillistHost *host,
                                       struct PointillistRenderer **out,
                                       struct PointillistError *error);

// Returns in `out` a renderer on another device, such as after the loss of one, with the clouds,
// settings and filters of `renderer`. Ids of clouds stay the same. Files are read again; clouds of
// the host's points have failed, to be removed and added again. The former renderer is to be freed
// before its device is destroyed.
enum PointillistResult pointillist_restore(struct PointillistRenderer *renderer,
                                           const struct PointillistHost *host,
                                           struct PointillistRenderer **out,
                                           struct PointillistError *error);

// Frees a renderer, which may be null. The device must have completed all frames.
void pointillist_free(struct PointillistRenderer *renderer);

// Opens files, or one index, as a cloud. Returns at once; a thread reads them. `color` names the
// attribute to show, or is null.
enum PointillistResult pointillist_open(struct PointillistRenderer *renderer,
                                        const char *const *files,
                                        size_t file_count,
                                        const char *color,
                                        uint64_t *cloud,
                                        struct PointillistError *error);

// Adds points of the host's memory as a cloud; they are copied.
enum PointillistResult pointillist_add_points(struct PointillistRenderer *renderer,
                                              const struct PointillistPoints *points,
                                              uint64_t *cloud,
                                              struct PointillistError *error);

// Adds points of a buffer of the host's device as a cloud. The next frame copies them; the buffer
// is not changed until the device has completed it.
enum PointillistResult pointillist_add_buffer(struct PointillistRenderer *renderer,
                                              const struct PointillistPointBuffer *points,
                                              uint64_t *cloud,
                                              struct PointillistError *error);

// Removes a cloud.
enum PointillistResult pointillist_remove(struct PointillistRenderer *renderer,
                                          uint64_t cloud,
                                          struct PointillistError *error);

// Shows or hides a cloud.
enum PointillistResult pointillist_set_visible(struct PointillistRenderer *renderer,
                                               uint64_t cloud,
                                               uint8_t visible,
                                               struct PointillistError *error);

// Moves a cloud: an affine matrix, column by column, from its coordinates to the host's world. It
// may also stretch, shear and mirror the cloud, but not flatten it. Clip boxes are in the cloud's
// own coordinates, lights in the host's world.
enum PointillistResult pointillist_set_transform(struct PointillistRenderer *renderer,
                                                 uint64_t cloud,
                                                 const double *columns,
                                                 struct PointillistError *error);

// Returns the state of a cloud; of a failed one, also the reason, as `error`'s message.
enum PointillistResult pointillist_state(struct PointillistRenderer *renderer,
                                         uint64_t cloud,
                                         enum PointillistCloudState *state,
                                         struct PointillistError *error);

// Sets style, effect, light, background, layer, opacity, clip, only, not, lod, budget, ramp,
// range, brightness, contrast, gamma, time or error, as on the command line. `only` and `not` are
// of clouds that are opened or added from then on; `lod` and `budget` are as in scene files.
enum PointillistResult pointillist_set(struct PointillistRenderer *renderer,
                                       const char *name,
                                       const char *value,
                                       struct PointillistError *error);

// Fills in the matrices of a view, whose width and height are set, so that it frames all clouds
// that are ready. `preset` is a PointillistPreset; `near` and `far` are depths of 1 and 0.
enum PointillistResult pointillist_frame_clouds(struct PointillistRenderer *renderer,
                                                int32_t preset,
                                                double near,
                                                double far,
                                                struct PointillistView *view,
                                                struct PointillistError *error);

// Records a frame into a command buffer that is being recorded, outside of rendering. The host
// submits it.
enum PointillistResult pointillist_record(struct PointillistRenderer *renderer,
                                          uint64_t command_buffer,
                                          const struct PointillistFrame *frame,
                                          struct PointillistReport *report,
                                          struct PointillistError *error);

// Takes back the last recorded frame, which the host neither has submitted nor will. The next
// frame, of a greater number, uploads again what this one did, and answers its picks.
enum PointillistResult pointillist_drop_frame(struct PointillistRenderer *renderer,
                                              uint64_t number,
                                              struct PointillistError *error);

// Describes the last frame, line by line: how complete it is, the state of each cloud, which
// effects run and why, device times of passes, errors. Writes as much of the text as `size` bytes
// hold, which ends with 0, and to `length`, which may be NULL, the length of all of it.
enum PointillistResult pointillist_explain(struct PointillistRenderer *renderer,
                                           char *text,
                                           size_t size,
                                           size_t *length,
                                           struct PointillistError *error);

// Requests the point in a pixel of the next frame. Clouds are asked, and not the host's geometry
// in front of them; the host compares depths.
enum PointillistResult pointillist_pick(struct PointillistRenderer *renderer,
                                        uint32_t x,
                                        uint32_t y,
                                        uint64_t *pick,
                                        struct PointillistError *error);

// Returns the answer to a pick, once; it comes with a frame after the one that was asked.
enum PointillistResult pointillist_picked(struct PointillistRenderer *renderer,
                                          uint64_t pick,
                                          struct PointillistPicked *picked,
                                          struct PointillistError *error);

// Writes a host without handles.
void pointillist_host_init(struct PointillistHost *to, size_t size);

// Writes an empty requirement.
void pointillist_requirement_init(struct PointillistRequirement *to, size_t size);

// Writes a target without an image, of one sample.
void pointillist_target_init(struct PointillistTarget *to, size_t size);

// Writes a view with unit matrices and no area.
void pointillist_view_init(struct PointillistView *to, size_t size);

// Writes a frame without targets and views, which writes depth.
void pointillist_frame_init(struct PointillistFrame *to, size_t size);

// Writes an empty report.
void pointillist_report_init(struct PointillistReport *to, size_t size);

// Writes no points.
void pointillist_points_init(struct PointillistPoints *to, size_t size);

// Writes an answer that is not there yet.
void pointillist_picked_init(struct PointillistPicked *to, size_t size);

// Writes a buffer without points.
void pointillist_point_buffer_init(struct PointillistPointBuffer *to, size_t size);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* POINTILLIST_H */

#ifndef POINTILLIST_DEFAULTS
#define POINTILLIST_DEFAULTS

static inline PointillistHost pointillist_host_default(void) {
  PointillistHost value;
  pointillist_host_init(&value, sizeof value);
  return value;
}

static inline PointillistRequirement pointillist_requirement_default(void) {
  PointillistRequirement value;
  pointillist_requirement_init(&value, sizeof value);
  return value;
}

static inline PointillistTarget pointillist_target_default(void) {
  PointillistTarget value;
  pointillist_target_init(&value, sizeof value);
  return value;
}

static inline PointillistView pointillist_view_default(void) {
  PointillistView value;
  pointillist_view_init(&value, sizeof value);
  return value;
}

static inline PointillistFrame pointillist_frame_default(void) {
  PointillistFrame value;
  pointillist_frame_init(&value, sizeof value);
  return value;
}

static inline PointillistReport pointillist_report_default(void) {
  PointillistReport value;
  pointillist_report_init(&value, sizeof value);
  return value;
}

static inline PointillistPoints pointillist_points_default(void) {
  PointillistPoints value;
  pointillist_points_init(&value, sizeof value);
  return value;
}

static inline PointillistPicked pointillist_picked_default(void) {
  PointillistPicked value;
  pointillist_picked_init(&value, sizeof value);
  return value;
}

static inline PointillistPointBuffer pointillist_point_buffer_default(void) {
  PointillistPointBuffer value;
  pointillist_point_buffer_init(&value, sizeof value);
  return value;
}

#endif
