//! The interface for C, behind the feature `c`: `include/pointillist.h`.
//!
//! Structs begin with their size, so that they can grow: their `_init` functions write as many bytes as
//! the caller's struct has, and the header's `_default` functions call them.
//! What the caller gives as a choice is an integer, so that every value may be checked.
//! Every function returns a [`PointillistResult`]; on failure, outputs are as they were, and the
//! last argument, which may be null, receives a message. Panics do not cross. A renderer is used by
//! one thread at a time; different renderers are independent.

#![allow(clippy::missing_safety_doc, reason = "the rules are those of the module and of Vulkan")]

use crate::error::{Error, Result};
use crate::renderer::{
    Access, Area, CloudId, CloudState, Encoding, Frame, FrameReport, FrameView, Host, Matrices,
    OpenSettings, PickId, Picked, PointBuffer, Points, Positions, Preset, Renderer,
    RendererOptions, Target, Targets, ViewCamera, check, enable_features,
};
use std::ffi::{CStr, c_char, c_void};
use std::ops::{Deref, DerefMut};
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::path::PathBuf;

/// Outcome of a function.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PointillistResult {
    /// Success.
    Ok = 0,
    /// A request makes no sense: null, a wrong number, an unknown name.
    Request = 1,
    /// A file cannot be read, or does not follow its format.
    File = 2,
    /// The device lacks something, or its memory is exhausted.
    Device = 3,
    /// The device is lost; the renderer can only be freed.
    DeviceLost = 4,
    /// A fault of pointillist; the renderer can only be freed.
    Panic = 5,
}

/// Message of a failure: UTF-8, ends with 0.
#[repr(C)]
pub struct PointillistError {
    pub message: [c_char; 1024],
}

/// A renderer.
pub struct PointillistRenderer {
    renderer: Renderer,
    /// Report of the last frame.
    report: FrameReport,
    /// True after a call that ended in a panic, which may have left it halfway.
    faulty: bool,
}

/// A renderer during a call.
struct Borrowed<'r>(&'r mut PointillistRenderer);

impl Deref for Borrowed<'_> {
    type Target = PointillistRenderer;

    fn deref(&self) -> &PointillistRenderer {
        self.0
    }
}

impl DerefMut for Borrowed<'_> {
    fn deref_mut(&mut self) -> &mut PointillistRenderer {
        self.0
    }
}

impl Drop for Borrowed<'_> {
    fn drop(&mut self) {
        self.0.faulty |= std::thread::panicking();
    }
}

/// The host's Vulkan objects; handles are cast to integers.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct PointillistHost {
    pub size: usize,
    /// Address of vkGetInstanceProcAddr.
    pub get_instance_proc_addr: *const c_void,
    pub instance: u64,
    pub physical_device: u64,
    pub device: u64,
    /// Family of the command buffers, with graphics and compute.
    pub queue_family: u32,
    /// Whether shaderInt64 and shaderBufferInt64Atomics are enabled: 0 or 1, as all of its kind.
    pub has_int64_atomics: u8,
    /// Whether the instance has VK_EXT_debug_utils.
    pub has_debug_utils: u8,
    /// Device memory for the nodes of each index, in bytes; 0 is the default.
    pub memory_budget: u64,
    /// Most points drawn of an index; 0 is automatic.
    pub point_budget: u64,
    /// VkAllocationCallbacks for the CPU memory of all objects that are made here, on any thread, or
    /// null. They are copied. Device memory is allocated without them.
    pub allocation_callbacks: *const c_void,
    /// Functions that are called, on any thread, in place of vkAllocateMemory and
    /// vkFreeMemory, for blocks of many buffers and images; both null if there are none. They may
    /// refuse with VK_ERROR_OUT_OF_DEVICE_MEMORY.
    pub allocate_memory: *const c_void,
    pub free_memory: *const c_void,
}

/// How an image was used, or will be: Vulkan's numbers. With a transfer of ownership between queue
/// families, the host records the other half of each barrier: before the frame a release from
/// `before.layout` to COLOR_ATTACHMENT_OPTIMAL (of depth: DEPTH_STENCIL_ATTACHMENT_OPTIMAL), after it
/// an acquisition from there to `after.layout`.
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
    pub size: usize,
    /// VkImage.
    pub image: u64,
    /// VkImageView.
    pub view: u64,
    /// VkFormat.
    pub format: i32,
    pub width: u32,
    pub height: u32,
    pub samples: u32,
    /// Last access before.
    pub before: PointillistAccess,
    /// First access afterwards.
    pub after: PointillistAccess,
    /// Whether the area is cleared first: colour to the background, depth to what is farthest.
    pub clear: u8,
}

/// A view: matrices column by column, in Vulkan's clip space, and its area in the targets.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct PointillistView {
    pub size: usize,
    /// From the world to the view.
    pub view: [f64; 16],
    /// From the view to clip space.
    pub projection: [f64; 16],
    pub x: i32,
    pub y: i32,
    pub width: u32,
    pub height: u32,
}

/// A frame.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct PointillistFrame {
    pub size: usize,
    /// Grows from frame to frame, from 1.
    pub number: u64,
    /// Last frame that the device has completed; 0 if none.
    pub safe: u64,
    pub color: *const PointillistTarget,
    /// Depth that points are hidden by; null if there is none.
    pub depth: *const PointillistTarget,
    /// Whether points' depth is written.
    pub writes_depth: u8,
    /// Whether colours are stored linear instead of encoded.
    pub linear: u8,
    pub views: *const PointillistView,
    pub view_count: usize,
    /// Ids of the points that are seen, VK_FORMAT_R32_UINT, or R32G32_UINT with the cloud as the
    /// second; null if not wanted.
    pub ids: *const PointillistTarget,
    /// Normals of the visible surface, world; null if not wanted.
    pub normals: *const PointillistTarget,
}

/// What a frame shows.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct PointillistReport {
    pub size: usize,
    /// Points drawn in all views.
    pub points: u64,
    /// Nodes that are missing, or coarser than the views call for.
    pub missing: u64,
    /// Number of clouds or nodes that could not be drawn.
    pub errors: u64,
    /// Whether everything that the views call for is drawn.
    pub settled: bool,
}

/// Points of the host's memory; arrays that are null are absent.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct PointillistPoints {
    pub size: usize,
    pub count: usize,
    /// x, y, z of each point; give these, those in f32, or steps.
    pub positions_f64: *const f64,
    pub positions_f32: *const f32,
    /// Red, green, blue of each point, sRGB.
    pub colors: *const u8,
    pub intensities: *const f32,
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
    pub size: usize,
    /// VkBuffer, with VK_BUFFER_USAGE_TRANSFER_SRC_BIT.
    pub buffer: u64,
    /// Byte of the first point, a multiple of 4.
    pub offset: u64,
    /// Bytes from point to point, a multiple of 4. A point begins with x, y and z, f32.
    pub stride: u32,
    pub count: u32,
    /// Byte of red, green and blue within a point, sRGB; UINT32_MAX if there are no colours.
    pub color_offset: u32,
}

/// State of a cloud.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PointillistCloudState {
    Loading = 0,
    Uploading = 1,
    Ready = 2,
    Failed = 3,
}

/// Where a camera looks from.
#[repr(C)]
#[derive(Clone, Copy)]
pub enum PointillistPreset {
    Top = 0,
    Front = 1,
    Side = 2,
    Iso = 3,
    Fit = 4,
}

/// Answer to a pick.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct PointillistPicked {
    pub size: usize,
    /// Whether there is an answer; if not, ask again after another frame.
    pub answered: bool,
    /// Whether a point was met; the rest is undefined if not.
    pub met: bool,
    /// Whether the position is the file's own, to the last bit.
    pub exact: bool,
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
}

/// Runs a function of the interface: failures and panics become results with a message.
fn guarded(error: *mut PointillistError, work: impl FnOnce() -> Result<()>) -> PointillistResult {
    let (result, message) = match catch_unwind(AssertUnwindSafe(work)) {
        Ok(Ok(())) => return PointillistResult::Ok,
        Ok(Err(why)) => (code(&why), why.to_string()),
        Err(_) => (PointillistResult::Panic, "a fault of pointillist".into()),
    };
    // SAFETY: null, or valid, as the caller ensures.
    if let Some(error) = unsafe { error.as_mut() } {
        copy(&message, &mut error.message);
    }
    result
}

/// Writes the default of a struct of a caller's size: members that it does not know are left out, and
/// members that only it knows are 0.
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

/// Copies text, as much as there is room for, and ends it with 0.
fn copy(text: &str, to: &mut [c_char]) {
    let Some(most) = to.len().checked_sub(1) else { return };
    let cut = (0..=text.len().min(most)).rev().find(|at| text.is_char_boundary(*at));
    let bytes = &text.as_bytes()[..cut.unwrap_or(0)];
    to.fill(0);
    to.iter_mut().zip(bytes).for_each(|(to, from)| *to = *from as c_char);
}

fn code(error: &Error) -> PointillistResult {
    match error {
        _ if error.is_lost_device() => PointillistResult::DeviceLost,
        Error::Request(_) | Error::Interrupted => PointillistResult::Request,
        Error::Io { .. } | Error::Format { .. } => PointillistResult::File,
        Error::Device(_) | Error::Vulkan { .. } | Error::Validation(_) => PointillistResult::Device,
    }
}

fn null<T>(name: &str) -> Result<T> {
    Err(Error::Request(format!("{name} is null")))
}

/// Reads a struct that begins with its size; members that the caller does not know are `default`.
///
/// # Safety
/// `from` is null or has as many bytes as it says.
unsafe fn sized<T: Copy>(from: *const T, default: T, name: &str) -> Result<T> {
    if from.is_null() {
        return null(name);
    }
    let mut value = default;
    // SAFETY: every such struct begins with its size, and has that many bytes.
    unsafe {
        let size = *from.cast::<usize>();
        if size < size_of::<usize>() || size > 1 << 16 {
            let what = format!("{name} has the size {size}; make it with its _default function");
            return Err(Error::Request(what));
        }
        let bytes = size.min(size_of::<T>());
        std::ptr::copy_nonoverlapping(from.cast::<u8>(), (&raw mut value).cast::<u8>(), bytes);
    }
    Ok(value)
}

/// Writes a struct that begins with its size, as far as the caller knows it.
///
/// # Safety
/// As for [`sized`].
unsafe fn give<T: Copy>(value: T, to: *mut T, name: &str) -> Result<()> {
    if to.is_null() {
        return null(name);
    }
    // SAFETY: as the caller ensures.
    unsafe {
        let size = *to.cast::<usize>();
        let bytes = size.min(size_of::<T>());
        std::ptr::copy_nonoverlapping((&raw const value).cast::<u8>(), to.cast::<u8>(), bytes);
        *to.cast::<usize>() = size;
    }
    Ok(())
}

/// Reads a choice of the caller. In C it is `true` or `false`, but memory may hold anything.
fn flag(value: u8, name: &str) -> Result<bool> {
    match value {
        0 | 1 => Ok(value == 1),
        _ => Err(Error::Request(format!("{name} is {value}; give 0 or 1"))),
    }
}

/// Reads a preset of the caller.
fn preset(value: i32) -> Result<Preset> {
    use PointillistPreset as Number;
    let presets = [
        (Number::Top, Preset::Top),
        (Number::Front, Preset::Front),
        (Number::Side, Preset::Side),
        (Number::Iso, Preset::Iso),
        (Number::Fit, Preset::Fit),
    ];
    let found = presets.into_iter().find(|(number, _)| *number as i32 == value);
    found.map(|(_, preset)| preset).ok_or_else(|| {
        Error::Request(format!(
            "there is no preset {value}; see PointillistPreset for those there are"
        ))
    })
}

/// Returns the renderer for one call; ends the call as a panic does if an earlier one ended so.
///
/// # Safety
/// `renderer` is null, or from [`pointillist_new`] and not freed.
unsafe fn renderer<'r>(renderer: *mut PointillistRenderer) -> Result<Borrowed<'r>> {
    // SAFETY: as the caller ensures.
    let renderer = unsafe { renderer.as_mut() }.map_or_else(|| null("renderer"), Ok)?;
    if renderer.faulty {
        resume_unwind(Box::new("an earlier call ended in a panic"));
    }
    Ok(Borrowed(renderer))
}

/// # Safety
/// `text` is null or ends with 0.
unsafe fn words<'t>(text: *const c_char, name: &str) -> Result<&'t str> {
    if text.is_null() {
        return null(name);
    }
    // SAFETY: as the caller ensures.
    let text = unsafe { CStr::from_ptr(text) };
    text.to_str().map_err(|_| Error::Request(format!("{name} is not UTF-8")))
}

/// Errors if no array is that long.
///
/// # Safety
/// `first` is null or has `count` items.
unsafe fn array<'a, T>(first: *const T, count: usize) -> Result<Option<&'a [T]>> {
    if count > isize::MAX as usize / size_of::<T>().max(1) {
        return Err(Error::Request(format!("an array of {count} items; memory ends before")));
    }
    // SAFETY: as the caller ensures.
    Ok((!first.is_null()).then(|| unsafe { std::slice::from_raw_parts(first, count) }))
}

const ACCESS: PointillistAccess =
    PointillistAccess { layout: 0, family: Access::SAME_FAMILY, stages: 0, access: 0 };

const TARGET: PointillistTarget = PointillistTarget {
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

/// Version of this interface: functions and members are only added while it is the same.
pub const POINTILLIST_VERSION: u32 = 1;

/// Returns the version of the library's interface, to be compared with POINTILLIST_VERSION.
#[unsafe(no_mangle)]
pub extern "C" fn pointillist_version() -> u32 {
    POINTILLIST_VERSION
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
        PointillistReport { size, points: 0, missing: 0, errors: 0, settled: false }
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
        }
    }
}

/// Writes an answer that is not there yet.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pointillist_picked_init(to: *mut PointillistPicked, size: usize) {
    // SAFETY: null, or of this size, as the caller ensures.
    unsafe { init(to, size) }
}

/// Checks a physical device, before the host creates its device.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pointillist_check(
    get_instance_proc_addr: *const c_void,
    instance: u64,
    physical_device: u64,
    error: *mut PointillistError,
) -> PointillistResult {
    // SAFETY: the handles are valid, as the caller ensures.
    guarded(error, || unsafe { check(get_instance_proc_addr, instance, physical_device) })
}

/// Enables what is required in a chain of VkPhysicalDeviceFeatures2 and structures that follow it:
/// VkPhysicalDeviceVulkan12Features and VkPhysicalDeviceVulkan13Features, or those of single
/// features. With `optional`, also what is optional, which the device must have.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pointillist_enable_features(
    chain: *mut c_void,
    optional: u8,
    error: *mut PointillistError,
) -> PointillistResult {
    // SAFETY: the chain is valid, as the caller ensures.
    guarded(error, || unsafe { enable_features(chain, flag(optional, "optional")?) })
}

/// Creates a renderer on the host's device, which must outlive it.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pointillist_new(
    host: *const PointillistHost,
    out: *mut *mut PointillistRenderer,
    error: *mut PointillistError,
) -> PointillistResult {
    guarded(error, || {
        if out.is_null() {
            return null("out");
        }
        // SAFETY: the pointers and handles are valid, as the caller ensures.
        unsafe {
            let host = sized(host, PointillistHost::default(), "host")?;
            let usual = RendererOptions::default();
            let options = RendererOptions {
                memory_budget: match host.memory_budget {
                    0 => usual.memory_budget,
                    bytes => bytes,
                },
                point_budget: Some(host.point_budget).filter(|points| *points > 0),
                ..usual
            };
            let host = Host {
                get_instance_proc_addr: host.get_instance_proc_addr,
                instance: host.instance,
                physical_device: host.physical_device,
                device: host.device,
                queue_family: host.queue_family,
                has_int64_atomics: flag(host.has_int64_atomics, "has_int64_atomics")?,
                has_debug_utils: flag(host.has_debug_utils, "has_debug_utils")?,
                allocation_callbacks: host.allocation_callbacks,
                allocate_memory: host.allocate_memory,
                free_memory: host.free_memory,
            };
            let renderer = Renderer::new(&host, options)?;
            *out = Box::into_raw(Box::new(PointillistRenderer {
                renderer,
                report: FrameReport::default(),
                faulty: false,
            }));
        }
        Ok(())
    })
}

/// Frees a renderer, which may be null. The device must have completed all frames.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pointillist_free(renderer: *mut PointillistRenderer) {
    guarded(std::ptr::null_mut(), || {
        if !renderer.is_null() {
            // SAFETY: made by `pointillist_new`, as the caller ensures.
            drop(unsafe { Box::from_raw(renderer) });
        }
        Ok(())
    });
}

/// Opens files, or one index, as a cloud. Returns at once; a thread reads them. `color` names the
/// attribute to show, or is null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pointillist_open(
    renderer: *mut PointillistRenderer,
    files: *const *const c_char,
    file_count: usize,
    color: *const c_char,
    cloud: *mut u64,
    error: *mut PointillistError,
) -> PointillistResult {
    guarded(error, || {
        // SAFETY: the pointers are valid, as the caller ensures.
        unsafe {
            let mut own = self::renderer(renderer)?;
            let names = array(files, file_count)?.map_or_else(|| null("files"), Ok)?;
            let path = |&name: &*const c_char| words(name, "a file").map(PathBuf::from);
            let paths = names.iter().map(path).collect::<Result<Vec<_>>>()?;
            let color = match color.is_null() {
                true => None,
                false => Some(words(color, "color")?.to_string()),
            };
            if cloud.is_null() {
                return null("cloud");
            }
            *cloud = own.renderer.open(&paths, &OpenSettings { color, strict: false })?.0;
        }
        Ok(())
    })
}

/// Adds points of the host's memory as a cloud; they are copied.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pointillist_add_points(
    renderer: *mut PointillistRenderer,
    points: *const PointillistPoints,
    cloud: *mut u64,
    error: *mut PointillistError,
) -> PointillistResult {
    guarded(error, || {
        // SAFETY: the pointers are valid and have `count` points, as the caller ensures.
        unsafe {
            let mut own = self::renderer(renderer)?;
            let points = sized(points, PointillistPoints::default(), "points")?;
            if cloud.is_null() {
                return null("cloud");
            }
            let count = points.count;
            let narrow = array(points.positions_f32.cast::<[f32; 3]>(), count)?;
            let steps = array(points.steps.cast::<[i32; 3]>(), count)?;
            let PointillistPoints { scale, offset, .. } = points;
            let positions = match array(points.positions_f64.cast::<[f64; 3]>(), count)? {
                Some(places) => Positions::F64(places),
                None => narrow
                    .map(Positions::F32)
                    .or(steps.map(|steps| Positions::Steps { steps, scale, offset }))
                    .map_or_else(|| null("positions"), Ok)?,
            };
            let points = Points {
                positions,
                colors: array(points.colors.cast::<[u8; 3]>(), count)?,
                intensities: array(points.intensities, count)?,
                classes: array(points.classes, count)?,
            };
            *cloud = own.renderer.add_points(&points)?.0;
        }
        Ok(())
    })
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

/// Adds points of a buffer of the host's device as a cloud. The next frame copies them; the buffer is
/// not changed until the device has completed it.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pointillist_add_buffer(
    renderer: *mut PointillistRenderer,
    points: *const PointillistPointBuffer,
    cloud: *mut u64,
    error: *mut PointillistError,
) -> PointillistResult {
    guarded(error, || {
        // SAFETY: pointers and buffer are valid, as the caller ensures.
        unsafe {
            let mut own = self::renderer(renderer)?;
            let points = sized(points, PointillistPointBuffer::default(), "points")?;
            if cloud.is_null() {
                return null("cloud");
            }
            let points = PointBuffer {
                buffer: points.buffer,
                offset: points.offset,
                stride: points.stride,
                count: points.count,
                color_offset: Some(points.color_offset).filter(|offset| *offset != u32::MAX),
            };
            *cloud = own.renderer.add_buffer(points)?.0;
        }
        Ok(())
    })
}

/// Removes a cloud.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pointillist_remove(
    renderer: *mut PointillistRenderer,
    cloud: u64,
    error: *mut PointillistError,
) -> PointillistResult {
    // SAFETY: as the caller ensures.
    guarded(error, || unsafe { self::renderer(renderer)?.renderer.remove(CloudId(cloud)) })
}

/// Shows or hides a cloud.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pointillist_set_visible(
    renderer: *mut PointillistRenderer,
    cloud: u64,
    visible: u8,
    error: *mut PointillistError,
) -> PointillistResult {
    guarded(error, || {
        let visible = flag(visible, "visible")?;
        // SAFETY: as the caller ensures.
        unsafe { self::renderer(renderer)? }.renderer.set_visible(CloudId(cloud), visible)
    })
}

/// Moves a cloud: an affine matrix, column by column, from its coordinates to the host's world. It may
/// also stretch, shear and mirror the cloud, but not flatten it. Clip boxes are in the cloud's own
/// coordinates, lights in the host's world.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pointillist_set_transform(
    renderer: *mut PointillistRenderer,
    cloud: u64,
    columns: *const f64,
    error: *mut PointillistError,
) -> PointillistResult {
    guarded(error, || {
        // SAFETY: as the caller ensures.
        unsafe {
            let mut own = self::renderer(renderer)?;
            let columns = columns.cast::<[f64; 16]>().as_ref();
            let columns = columns.map_or_else(|| null("columns"), Ok)?;
            own.renderer.set_transform(CloudId(cloud), columns)
        }
    })
}

/// Returns the state of a cloud; of a failed one, also the reason, as `error`'s message.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pointillist_state(
    renderer: *mut PointillistRenderer,
    cloud: u64,
    state: *mut PointillistCloudState,
    error: *mut PointillistError,
) -> PointillistResult {
    let mut why = None;
    let result = guarded(error, || {
        if state.is_null() {
            return null("state");
        }
        // SAFETY: as the caller ensures.
        let own = unsafe { self::renderer(renderer)? };
        let found = match own.renderer.state(CloudId(cloud))? {
            CloudState::Loading { .. } => PointillistCloudState::Loading,
            CloudState::Uploading => PointillistCloudState::Uploading,
            CloudState::Ready => PointillistCloudState::Ready,
            CloudState::Failed(reason) => {
                why = Some(reason);
                PointillistCloudState::Failed
            }
        };
        // What is there may be no state yet, so it is written without a reference.
        // SAFETY: as the caller ensures.
        unsafe { state.write(found) };
        Ok(())
    });
    if let Some(why) = why {
        guarded(error, || Err(Error::Request(why)));
    }
    result
}

/// Sets style, effect, light, background, layer, opacity, clip, time or error, as on the command line.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pointillist_set(
    renderer: *mut PointillistRenderer,
    name: *const c_char,
    value: *const c_char,
    error: *mut PointillistError,
) -> PointillistResult {
    guarded(error, || {
        // SAFETY: as the caller ensures.
        unsafe {
            let mut own = self::renderer(renderer)?;
            own.renderer.set(words(name, "name")?, words(value, "value")?)
        }
    })
}

/// Fills in the matrices of a view, whose width and height are set, so that it frames all clouds
/// that are ready. `preset` is a PointillistPreset; `near` and `far` are depths of 1 and 0.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pointillist_frame_clouds(
    renderer: *mut PointillistRenderer,
    preset: i32,
    near: f64,
    far: f64,
    view: *mut PointillistView,
    error: *mut PointillistError,
) -> PointillistResult {
    guarded(error, || {
        // SAFETY: as the caller ensures.
        unsafe {
            let own = self::renderer(renderer)?;
            let mut found = sized(view, PointillistView::default(), "view")?;
            let preset = self::preset(preset)?;
            let size = [found.width, found.height];
            if size.contains(&0) {
                return Err(Error::Request("the view has no width or height".into()));
            }
            let camera = own.renderer.framing(preset, size);
            let camera = camera.ok_or_else(|| Error::Request("no cloud is ready".into()))?;
            let matrices = Matrices::of(&camera, size, near, far)?;
            (found.view, found.projection) = (matrices.view, matrices.projection);
            give(found, view, "view")
        }
    })
}

fn target(target: &PointillistTarget) -> Result<Target> {
    let access = |access: PointillistAccess| Access {
        layout: access.layout,
        stages: access.stages,
        access: access.access,
        family: access.family,
    };
    Ok(Target {
        image: target.image,
        view: target.view,
        format: target.format,
        size: [target.width, target.height],
        samples: target.samples,
        before: access(target.before),
        after: access(target.after),
        clear: flag(target.clear, "clear")?,
    })
}

/// Records a frame into a command buffer that is being recorded, outside of rendering. The host
/// submits it.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pointillist_record(
    renderer: *mut PointillistRenderer,
    command_buffer: u64,
    frame: *const PointillistFrame,
    report: *mut PointillistReport,
    error: *mut PointillistError,
) -> PointillistResult {
    guarded(error, || {
        // SAFETY: the pointers and handles are valid, as the caller ensures.
        unsafe {
            let mut own = self::renderer(renderer)?;
            let frame = sized(frame, PointillistFrame::default(), "frame")?;
            if command_buffer == 0 {
                return null("command_buffer");
            }
            let view = |number: usize| {
                // The caller's views are as far apart as it knows them.
                let first = frame.views.cast::<u8>();
                let apart = *first.cast::<usize>();
                let view = first.add(number * apart).cast::<PointillistView>();
                let view = sized(view, PointillistView::default(), "a view")?;
                let matrices = Matrices { view: view.view, projection: view.projection };
                Ok(FrameView {
                    camera: ViewCamera::Matrices(matrices),
                    area: Area { corner: [view.x, view.y], size: [view.width, view.height] },
                })
            };
            if frame.views.is_null() && frame.view_count > 0 {
                return null("views");
            }
            let views = (0..frame.view_count).map(view).collect::<Result<Vec<_>>>()?;
            let optional = |given: *const PointillistTarget, name| match given.is_null() {
                true => Ok(None),
                false => target(&sized(given, TARGET, name)?).map(Some),
            };
            let targets = Targets {
                color: target(&sized(frame.color, TARGET, "color")?)?,
                encoding: match flag(frame.linear, "linear")? {
                    true => Encoding::Linear,
                    false => Encoding::Srgb,
                },
                depth: optional(frame.depth, "depth")?,
                writes_depth: flag(frame.writes_depth, "writes_depth")?,
                ids: optional(frame.ids, "ids")?,
                normals: optional(frame.normals, "normals")?,
            };
            let frame = Frame { number: frame.number, safe: frame.safe, targets, views: &views };
            let found = own.renderer.record(command_buffer, &frame)?;
            if !report.is_null() {
                let given = PointillistReport {
                    points: found.points,
                    missing: found.missing as u64,
                    errors: found.errors.len() as u64,
                    settled: found.settled,
                    ..PointillistReport::default()
                };
                give(given, report, "report")?;
            }
            own.report = found;
        }
        Ok(())
    })
}

/// Describes the last frame, line by line: how complete it is, the state of each cloud, which effects
/// run and why, device times of passes, errors. Writes as much of the text as `size` bytes hold, which
/// ends with 0, and to `length`, which may be NULL, the length of all of it.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pointillist_explain(
    renderer: *mut PointillistRenderer,
    text: *mut c_char,
    size: usize,
    length: *mut usize,
    error: *mut PointillistError,
) -> PointillistResult {
    guarded(error, || {
        // SAFETY: `text` is null or has `size` bytes, as the caller ensures.
        unsafe {
            let own = self::renderer(renderer)?;
            if text.is_null() && size > 0 {
                return null("text");
            }
            let found = own.renderer.explain(&own.report);
            if size > 0 {
                // The caller's memory may be undefined.
                text.write_bytes(0, size);
                copy(&found, std::slice::from_raw_parts_mut(text, size));
            }
            if let Some(length) = length.as_mut() {
                *length = found.len();
            }
        }
        Ok(())
    })
}

/// Requests the point in a pixel of the next frame.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pointillist_pick(
    renderer: *mut PointillistRenderer,
    x: u32,
    y: u32,
    pick: *mut u64,
    error: *mut PointillistError,
) -> PointillistResult {
    guarded(error, || {
        // SAFETY: as the caller ensures.
        let (mut own, pick) = unsafe { (self::renderer(renderer)?, pick.as_mut()) };
        let pick = pick.map_or_else(|| null("pick"), Ok)?;
        *pick = own.renderer.pick([x, y]).0;
        Ok(())
    })
}

/// Returns the answer to a pick, once; it comes with a frame after the one that was asked.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pointillist_picked(
    renderer: *mut PointillistRenderer,
    pick: u64,
    picked: *mut PointillistPicked,
    error: *mut PointillistError,
) -> PointillistResult {
    guarded(error, || {
        // SAFETY: as the caller ensures.
        let mut own = unsafe { self::renderer(renderer)? };
        let found = match own.renderer.picked(PickId(pick)) {
            Picked::Pending => PointillistPicked::default(),
            Picked::Nothing => PointillistPicked { answered: true, ..PointillistPicked::default() },
            Picked::Point(point) => PointillistPicked {
                answered: true,
                met: true,
                exact: point.exact,
                cloud: point.cloud.0,
                world: point.world.to_array(),
                position: point.position.to_array(),
                id: point.id.unwrap_or(u32::MAX),
                class_code: point.class.map_or(-1, i32::from),
                return_number: point.return_number.map_or(-1, i32::from),
                station: {
                    let mut station = [0; 256];
                    copy(point.station.as_deref().unwrap_or_default(), &mut station);
                    station
                },
                ..PointillistPicked::default()
            },
        };
        // SAFETY: as the caller ensures.
        unsafe { give(found, picked, "picked") }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Runs a call that must be refused. Returns its message.
    fn refused(call: impl FnOnce(*mut PointillistError) -> PointillistResult) -> String {
        let mut error = PointillistError { message: [0; 1024] };
        assert_eq!(call(&raw mut error), PointillistResult::Request);
        // SAFETY: messages end with 0.
        unsafe { CStr::from_ptr(error.message.as_ptr()) }.to_str().unwrap().into()
    }

    /// Every function refuses every null that it may not have, and its outputs stay.
    #[test]
    fn null_is_refused_by_every_function() {
        let none = std::ptr::null_mut::<PointillistRenderer>();
        let (mut cloud, mut pick) = (7, 7);
        let (name, value) = (c"style".as_ptr(), c"points".as_ptr());
        let file = [c"scan.laz".as_ptr()];
        let points = PointillistPoints::default();
        let (buffer, unit) = (PointillistPointBuffer::default(), [0.0; 16]);
        let (mut view, frame) = (PointillistView::default(), PointillistFrame::default());
        let mut state = PointillistCloudState::Failed;
        let mut picked = PointillistPicked::default();
        let (host, mut made) = (PointillistHost::default(), none);
        let null = std::ptr::null::<u8>();
        let (to_cloud, to_pick, to_made) = (&raw mut cloud, &raw mut pick, &raw mut made);
        let (to_view, to_state, to_picked) = (&raw mut view, &raw mut state, &raw mut picked);
        type Error = *mut PointillistError;
        // SAFETY: null is refused before anything is read.
        unsafe {
            let all: [&mut dyn FnMut(Error) -> PointillistResult; 18] = [
                &mut |e| pointillist_check(null.cast(), 0, 0, e),
                &mut |e| pointillist_new(null.cast(), to_made, e),
                &mut |e| pointillist_new(&raw const host, null.cast_mut().cast(), e),
                &mut |e| pointillist_new(&raw const host, to_made, e),
                &mut |e| pointillist_open(none, file.as_ptr(), 1, null.cast(), to_cloud, e),
                &mut |e| pointillist_add_points(none, &raw const points, to_pick, e),
                &mut |e| pointillist_add_buffer(none, &raw const buffer, to_pick, e),
                &mut |e| pointillist_remove(none, 1, e),
                &mut |e| pointillist_set_visible(none, 1, 1, e),
                &mut |e| pointillist_set_transform(none, 1, unit.as_ptr(), e),
                &mut |e| pointillist_state(none, 1, to_state, e),
                &mut |e| pointillist_set(none, name, value, e),
                &mut |e| pointillist_frame_clouds(none, 4, 0.1, 1.0, to_view, e),
                &mut |e| pointillist_record(none, 1, &raw const frame, null.cast_mut().cast(), e),
                &mut |e| pointillist_pick(none, 1, 1, to_pick, e),
                &mut |e| pointillist_picked(none, 1, to_picked, e),
                &mut |e| pointillist_enable_features(null.cast_mut().cast(), 0, e),
                &mut |e| {
                    pointillist_explain(none, null.cast_mut().cast(), 0, null.cast_mut().cast(), e)
                },
            ];
            for (number, call) in all.into_iter().enumerate() {
                let mut call = |e| call(e);
                let said = refused(&mut call);
                assert!(said.contains("null") || said.contains("chain has no"), "{number}: {said}");
                // Without a place for the message, too.
                assert_eq!(call(std::ptr::null_mut()), PointillistResult::Request);
            }
            pointillist_free(none);
        }
        assert_eq!((cloud, pick, state), (7, 7, PointillistCloudState::Failed));
        assert!(!picked.answered && made.is_null());
    }

    /// Structs of newer and of broken callers.
    #[test]
    fn sizes_are_read_as_far_as_they_go() {
        let of_size =
            |size: usize| PointillistPoints { size, count: 5, ..PointillistPoints::default() };
        let read = |size: usize| {
            let points = of_size(size);
            // SAFETY: no more than the struct is read.
            unsafe { sized(&raw const points, PointillistPoints::default(), "points") }
        };
        for size in [0, 1, size_of::<usize>() - 1, (1 << 16) + 1, usize::MAX] {
            let refused = read(size).err().expect("a wrong size").to_string();
            assert!(refused.contains("_default"), "{refused}");
        }
        // A caller that knows the size alone, and one that knows more than we do.
        assert_eq!(read(size_of::<usize>()).unwrap().count, 0);
        assert_eq!(read(size_of::<PointillistPoints>() + 64).unwrap().count, 5);
    }

    /// A caller of an older header, and one of a newer.
    #[test]
    fn defaults_are_as_large_as_the_caller_says() {
        const LARGEST: usize = size_of::<PointillistView>() + 32;
        for size in [0, 4, size_of::<usize>(), 40, size_of::<PointillistView>(), LARGEST] {
            let mut memory = [0xAAu8; LARGEST + 8];
            // SAFETY: the memory has more bytes than that.
            unsafe { pointillist_view_init(memory.as_mut_ptr().cast(), size) };
            let written = if size < size_of::<usize>() { 0 } else { size };
            assert!(memory[written..].iter().all(|byte| *byte == 0xAA), "{size}");
            if written > 0 {
                assert_eq!(memory[..size_of::<usize>()], size.to_ne_bytes());
            }
            if size == LARGEST {
                assert!(
                    memory[size_of::<PointillistView>()..LARGEST].iter().all(|byte| *byte == 0)
                );
            }
        }
        // SAFETY: null is left alone.
        unsafe { pointillist_view_init(std::ptr::null_mut(), LARGEST) };
    }

    #[test]
    fn numbers_that_are_no_choice_are_refused() {
        assert_eq!(preset(PointillistPreset::Iso as i32).unwrap(), Preset::Iso);
        for number in [-1, 5, i32::MAX] {
            let said = preset(number).unwrap_err().to_string();
            assert!(said.contains(&format!("no preset {number}")), "{said}");
        }
        let null = std::ptr::null_mut();
        // SAFETY: refused before anything is read.
        let said = refused(|error| unsafe { pointillist_enable_features(null, 2, error) });
        assert_eq!(said, "optional is 2; give 0 or 1");
        let host = PointillistHost { has_debug_utils: 255, ..PointillistHost::default() };
        let mut made = std::ptr::null_mut();
        // SAFETY: as above.
        let said =
            refused(|error| unsafe { pointillist_new(&raw const host, &raw mut made, error) });
        assert_eq!(said, "has_debug_utils is 255; give 0 or 1");
        assert!(made.is_null());
        let wrong = PointillistTarget { clear: 7, ..TARGET };
        assert!(target(&wrong).unwrap_err().to_string().contains("clear is 7"));
        // SAFETY: refused before anything is read.
        let endless = unsafe { array([0.0f64].as_ptr(), usize::MAX) }.unwrap_err();
        assert!(endless.to_string().contains("memory ends before"), "{endless}");
    }
}
