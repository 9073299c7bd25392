//! Structs of the interface for C, which begin with their size, and their defaults.

use crate::renderer::Access;
use std::ffi::{c_char, c_void};

/// The host's Vulkan objects; handles are cast to integers.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct PointillistHost {
    /// Bytes of this struct, as its `_init` function sets them.
    pub size: usize,
    /// Address of vkGetInstanceProcAddr.
    pub get_instance_proc_addr: *const c_void,
    /// VkInstance.
    pub instance: u64,
    /// VkPhysicalDevice.
    pub physical_device: u64,
    /// VkDevice.
    pub device: u64,
    /// Family of the command buffers, with graphics and compute.
    pub queue_family: u32,
    /// 1 if shaderInt64 and shaderBufferInt64Atomics are enabled, else 0, as all of its kind.
    pub has_int64_atomics: u8,
    /// 1 if the instance has VK_EXT_debug_utils.
    pub has_debug_utils: u8,
    /// Device memory for nodes of indexes, which share it equally, in bytes; 0 is the default.
    pub memory_budget: u64,
    /// Most points drawn of an index; 0 is automatic.
    pub point_budget: u64,
    /// VkAllocationCallbacks for the CPU memory of all objects that are made here, on any thread,
    /// or null. They are copied. Device memory is allocated without them.
    pub allocation_callbacks: *const c_void,
    /// Function that is called, on any thread, in place of vkAllocateMemory, for blocks of many
    /// buffers and images; null if there is none. It may refuse with
    /// VK_ERROR_OUT_OF_DEVICE_MEMORY.
    pub allocate_memory: *const c_void,
    /// Function that is called in place of vkFreeMemory, on any thread; null if there is none. It
    /// is given if and only if `allocate_memory` is.
    pub free_memory: *const c_void,
}

/// A device feature that drawing needs, or uses if it is enabled. Text is UTF-8 and ends with 0.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct PointillistRequirement {
    /// Bytes of this struct.
    pub size: usize,
    /// 1 if nothing works without it.
    pub required: bool,
    /// Vulkan structure that has the member.
    pub structure: [c_char; 64],
    /// Name of the member, such as synchronization2.
    pub feature: [c_char; 64],
    /// What it is for.
    pub purpose: [c_char; 256],
}

/// How an image was used, or will be: Vulkan's numbers. With a transfer of ownership between queue
/// families, the host records the other half of each barrier: before the frame a release from
/// `before.layout` to COLOR_ATTACHMENT_OPTIMAL (of depth: DEPTH_STENCIL_ATTACHMENT_OPTIMAL), after
/// it an acquisition from there to `after.layout`.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct PointillistAccess {
    /// VkImageLayout.
    pub layout: i32,
    /// Queue family that owns the image; UINT32_MAX if it is the renderer's.
    pub family: u32,
    /// VkPipelineStageFlags2.
    pub stages: u64,
    /// VkAccessFlags2.
    pub access: u64,
}

/// An image of the host to draw into: one layer, one level, one sample.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct PointillistTarget {
    /// Bytes of this struct.
    pub size: usize,
    /// VkImage.
    pub image: u64,
    /// VkImageView.
    pub view: u64,
    /// VkFormat.
    pub format: i32,
    /// Width of the image, in pixels.
    pub width: u32,
    /// Height of the image, in pixels.
    pub height: u32,
    /// Samples of each pixel, 1: others are refused.
    pub samples: u32,
    /// Last access before.
    pub before: PointillistAccess,
    /// First access afterwards.
    pub after: PointillistAccess,
    /// 1 if the area is cleared first: colour to the background, depth to what is farthest.
    pub clear: u8,
}

/// A view: matrices column by column, in Vulkan's clip space, and its area in the targets.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct PointillistView {
    /// Bytes of this struct.
    pub size: usize,
    /// From the world to the view.
    pub view: [f64; 16],
    /// From the view to clip space.
    pub projection: [f64; 16],
    /// Left pixel of the area, which lies within the targets.
    pub x: i32,
    /// Top pixel of the area.
    pub y: i32,
    /// Pixels of each row.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

/// A frame.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct PointillistFrame {
    /// Bytes of this struct.
    pub size: usize,
    /// Grows from frame to frame, from 1.
    pub number: u64,
    /// Last frame that the device has completed; 0 if none.
    pub safe: u64,
    /// Colours that are drawn.
    pub color: *const PointillistTarget,
    /// Depth that points are hidden by; null if there is none.
    pub depth: *const PointillistTarget,
    /// 1 if points' depth is written.
    pub writes_depth: u8,
    /// 1 if colours are stored linear instead of encoded.
    pub linear: u8,
    /// Views, one after another.
    pub views: *const PointillistView,
    /// Number of views.
    pub view_count: usize,
    /// Ids of the points that are seen, VK_FORMAT_R32_UINT, or R32G32_UINT with the cloud as the
    /// second; null if not wanted.
    pub ids: *const PointillistTarget,
    /// Normals of the visible surface, world; null if not wanted.
    pub normals: *const PointillistTarget,
    /// 1 if the depth image has the usages of a source and a destination of transfers. Then the
    /// host's geometry hides each layer of translucent points by itself, and several clouds hide
    /// each other even if their depth is not written.
    pub copies_depth: u8,
}

/// What a frame shows.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct PointillistReport {
    /// Bytes of this struct.
    pub size: usize,
    /// Points drawn in all views.
    pub points: u64,
    /// Nodes that are missing, or coarser than the views call for.
    pub missing: u64,
    /// Data of clouds that has come to the device since the last frame, in bytes: at most
    /// 32 MiB of files and points, and as much of indexes.
    pub streamed: u64,
    /// Number of clouds or nodes that could not be drawn.
    pub errors: u64,
    /// 1 if everything that the views call for is drawn.
    pub settled: bool,
}

/// Points of the host's memory; arrays that are null are absent.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct PointillistPoints {
    /// Bytes of this struct.
    pub size: usize,
    /// Number of points.
    pub count: usize,
    /// x, y, z of each point; give these, those in f32, or steps.
    pub positions_f64: *const f64,
    /// The same in f32.
    pub positions_f32: *const f32,
    /// Red, green, blue of each point, sRGB.
    pub colors: *const u8,
    /// Intensity of each point.
    pub intensities: *const f32,
    /// ASPRS class of each point.
    pub classes: *const u8,
    /// x, y, z of each point as steps of a lattice, kept as they are: offset + scale * step.
    pub steps: *const i32,
    /// Width of a step along each axis.
    pub scale: [f64; 3],
    /// Position of step 0.
    pub offset: [f64; 3],
}

/// Points in a buffer of the host's device; see `pointillist_add_buffer`.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct PointillistPointBuffer {
    /// Bytes of this struct.
    pub size: usize,
    /// VkBuffer, with VK_BUFFER_USAGE_TRANSFER_SRC_BIT.
    pub buffer: u64,
    /// Byte of the first point, a multiple of 4.
    pub offset: u64,
    /// Bytes from point to point, a multiple of 4. A point begins with x, y and z, f32.
    pub stride: u32,
    /// Number of points.
    pub count: u32,
    /// Byte of red, green and blue within a point, sRGB; UINT32_MAX if there are no colours.
    pub color_offset: u32,
}

/// State of a cloud.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PointillistCloudState {
    /// Files are being read, or points copied and prepared.
    Loading = 0,
    /// Points are being uploaded, some with each frame.
    Uploading = 1,
    /// The cloud is drawn; of an index, nodes still come and go.
    Ready = 2,
    /// The files cannot be read, or memory is exhausted.
    Failed = 3,
}

/// Where a camera looks from.
#[repr(C)]
#[derive(Clone, Copy)]
pub enum PointillistPreset {
    /// View from above, north up, without perspective.
    Top = 0,
    /// View from the south, without perspective.
    Front = 1,
    /// View from the east, without perspective.
    Side = 2,
    /// View from a corner, without perspective.
    Iso = 3,
    /// Oblique, with perspective, near enough to fill the picture.
    Fit = 4,
}

/// Answer to a pick.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct PointillistPicked {
    /// Bytes of this struct.
    pub size: usize,
    /// 1 if there is an answer; if not, ask again after another frame.
    pub answered: bool,
    /// 1 if a point was met; the rest is undefined if not.
    pub met: bool,
    /// 1 if the position is the file's own, to the last bit.
    pub exact: bool,
    /// Cloud of the point.
    pub cloud: u64,
    /// In the host's world.
    pub world: [f64; 3],
    /// In the cloud's own coordinates.
    pub position: [f64; 3],
    /// Number of the point, as the ids of its frame have it; UINT32_MAX if it is no single one.
    pub id: u32,
    /// ASPRS class of that point, 0 if it has none; -1 if there is no single point.
    pub class_code: i32,
    /// Number of its return, 0 if it has none; -1 if there is no single point.
    pub return_number: i32,
    /// Name of the file or station that it is from: UTF-8, ends with 0, cut if longer.
    pub station: [c_char; 256],
    /// Colour that it is drawn with before lighting and exposure: 8-bit sRGB, and 255; all 0 if
    /// there is no single point.
    pub color: [u8; 4],
    /// Number that it is coloured by: its intensity, class or source as in the file; its elevation
    /// `[m]`, time `[s]` or scalar within 1/65,535 of the cloud's range. NaN if there is none.
    pub value: f64,
    /// Planar depth `[m]`: in the cloud's units, or in the world's if its transform is no
    /// similarity.
    pub depth: f64,
}

pub(super) const ACCESS: PointillistAccess =
    PointillistAccess { layout: 0, family: Access::SAME_FAMILY, stages: 0, access: 0 };

pub(super) const TARGET: PointillistTarget = PointillistTarget {
    size: size_of::<PointillistTarget>(),
    image: 0,
    view: 0,
    format: 0,
    width: 0,
    height: 0,
    samples: 1,
    before: ACCESS,
    after: ACCESS,
    clear: 0,
};

/// Writes the default of a struct of a caller's size: members that it does not know are left out,
/// and members that only it knows are 0.
///
/// # Safety
/// `to` is null or has `size` bytes.
unsafe fn init<T: Copy + Default>(to: *mut T, size: usize) {
    if to.is_null() || size < size_of::<usize>() {
        return;
    }
    let (value, bytes) = (T::default(), size.min(size_of::<T>()));
    // SAFETY: as the caller ensures; every such struct begins with its size.
    unsafe {
        to.cast::<u8>().write_bytes(0, size);
        std::ptr::copy_nonoverlapping((&raw const value).cast::<u8>(), to.cast::<u8>(), bytes);
        to.cast::<usize>().write_unaligned(size);
    }
}

impl Default for PointillistHost {
    fn default() -> PointillistHost {
        PointillistHost {
            size: size_of::<PointillistHost>(),
            get_instance_proc_addr: std::ptr::null(),
            instance: 0,
            physical_device: 0,
            device: 0,
            queue_family: 0,
            has_int64_atomics: 0,
            has_debug_utils: 0,
            memory_budget: 0,
            point_budget: 0,
            allocation_callbacks: std::ptr::null(),
            allocate_memory: std::ptr::null(),
            free_memory: std::ptr::null(),
        }
    }
}

/// Writes a host without handles.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pointillist_host_init(to: *mut PointillistHost, size: usize) {
    // SAFETY: null, or of this size, as the caller ensures.
    unsafe { init(to, size) }
}

impl Default for PointillistRequirement {
    fn default() -> PointillistRequirement {
        PointillistRequirement {
            size: size_of::<PointillistRequirement>(),
            required: false,
            structure: [0; 64],
            feature: [0; 64],
            purpose: [0; 256],
        }
    }
}

/// Writes an empty requirement.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pointillist_requirement_init(
    to: *mut PointillistRequirement,
    size: usize,
) {
    // SAFETY: null, or of this size, as the caller ensures.
    unsafe { init(to, size) }
}

impl Default for PointillistTarget {
    fn default() -> PointillistTarget {
        TARGET
    }
}

/// Writes a target without an image, of one sample.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pointillist_target_init(to: *mut PointillistTarget, size: usize) {
    // SAFETY: null, or of this size, as the caller ensures.
    unsafe { init(to, size) }
}

impl Default for PointillistView {
    fn default() -> PointillistView {
        let unit = glam::DMat4::IDENTITY.to_cols_array();
        PointillistView {
            size: size_of::<PointillistView>(),
            view: unit,
            projection: unit,
            x: 0,
            y: 0,
            width: 0,
            height: 0,
        }
    }
}

/// Writes a view with unit matrices and no area.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pointillist_view_init(to: *mut PointillistView, size: usize) {
    // SAFETY: null, or of this size, as the caller ensures.
    unsafe { init(to, size) }
}

impl Default for PointillistFrame {
    fn default() -> PointillistFrame {
        PointillistFrame {
            size: size_of::<PointillistFrame>(),
            number: 0,
            safe: 0,
            color: std::ptr::null(),
            depth: std::ptr::null(),
            writes_depth: 1,
            linear: 0,
            views: std::ptr::null(),
            view_count: 0,
            ids: std::ptr::null(),
            normals: std::ptr::null(),
            copies_depth: 0,
        }
    }
}

/// Writes a frame without targets and views, which writes depth.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pointillist_frame_init(to: *mut PointillistFrame, size: usize) {
    // SAFETY: null, or of this size, as the caller ensures.
    unsafe { init(to, size) }
}

impl Default for PointillistReport {
    fn default() -> PointillistReport {
        let size = size_of::<PointillistReport>();
        PointillistReport { size, points: 0, missing: 0, streamed: 0, errors: 0, settled: false }
    }
}

/// Writes an empty report.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pointillist_report_init(to: *mut PointillistReport, size: usize) {
    // SAFETY: null, or of this size, as the caller ensures.
    unsafe { init(to, size) }
}

impl Default for PointillistPoints {
    fn default() -> PointillistPoints {
        PointillistPoints {
            size: size_of::<PointillistPoints>(),
            count: 0,
            positions_f64: std::ptr::null(),
            positions_f32: std::ptr::null(),
            colors: std::ptr::null(),
            intensities: std::ptr::null(),
            classes: std::ptr::null(),
            steps: std::ptr::null(),
            scale: [1.0; 3],
            offset: [0.0; 3],
        }
    }
}

/// Writes no points.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pointillist_points_init(to: *mut PointillistPoints, size: usize) {
    // SAFETY: null, or of this size, as the caller ensures.
    unsafe { init(to, size) }
}

impl Default for PointillistPicked {
    fn default() -> PointillistPicked {
        PointillistPicked {
            size: size_of::<PointillistPicked>(),
            answered: false,
            met: false,
            exact: false,
            cloud: 0,
            world: [0.0; 3],
            position: [0.0; 3],
            id: u32::MAX,
            class_code: -1,
            return_number: -1,
            station: [0; 256],
            color: [0; 4],
            value: f64::NAN,
            depth: f64::NAN,
        }
    }
}

/// Writes an answer that is not there yet.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pointillist_picked_init(to: *mut PointillistPicked, size: usize) {
    // SAFETY: null, or of this size, as the caller ensures.
    unsafe { init(to, size) }
}

impl Default for PointillistPointBuffer {
    fn default() -> PointillistPointBuffer {
        let size = size_of::<PointillistPointBuffer>();
        let (buffer, offset, stride, count) = (0, 0, 12, 0);
        PointillistPointBuffer { size, buffer, offset, stride, count, color_offset: u32::MAX }
    }
}

/// Writes a buffer without points.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pointillist_point_buffer_init(
    to: *mut PointillistPointBuffer,
    size: usize,
) {
    // SAFETY: null, or of this size, as the caller ensures.
    unsafe { init(to, size) }
}
