//! The interface for C, behind the feature `c`: `include/pointillist.h`.
//!
//! Structs begin with their size, so that they can grow: their `_init` functions write as many
//! bytes as the caller's struct has, and the header's `_default` functions call them.
//! What the caller gives as a choice is an integer, so that every value may be checked.
//! Every function returns a [`PointillistResult`]; on failure, outputs are as they were, and the
//! last argument, which may be null, receives a message. Panics do not cross. A renderer is used by
//! one thread at a time, a call that meets another one is refused; different renderers are
//! independent.

#![deny(missing_docs)]
#![allow(clippy::missing_safety_doc, reason = "the rules are those of the module and of Vulkan")]

mod arguments;
mod structs;
#[cfg(test)]
mod tests;

pub use structs::*;

use arguments::{
    array, code, copy, flag, give, null, preset, renderer, room, sized, target, words,
};

use crate::error::{Error, Result};
use crate::renderer::{
    Area, CloudId, CloudState, Encoding, Frame, FrameReport, FrameView, Host, Matrices,
    OpenSettings, PickId, Picked, PointBuffer, Points, Positions, Renderer, RendererOptions,
    Targets, ViewCamera, check, enable_features, requirements,
};
use std::cell::UnsafeCell;
use std::ffi::{c_char, c_void};
use std::ops::{Deref, DerefMut};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering::Release};

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
    /// The device is lost; the renderer can only be restored on another one, or freed.
    DeviceLost = 4,
    /// A fault of pointillist; the renderer can only be freed.
    Panic = 5,
}

/// Message of a failure: UTF-8, ends with 0.
#[repr(C)]
pub struct PointillistError {
    /// The message, cut if longer.
    pub message: [c_char; 1024],
}

/// A renderer.
pub struct PointillistRenderer {
    own: UnsafeCell<Own>,
    /// True during a call.
    busy: AtomicBool,
}

/// Renderer, and the state of its calls.
struct Own {
    renderer: Renderer,
    /// Report of the last frame.
    report: FrameReport,
    /// True after a call that ended in a panic, which may have left it halfway.
    faulty: bool,
}

/// A renderer during a call, which no other call has.
struct Borrowed<'r>(&'r PointillistRenderer);

impl Deref for Borrowed<'_> {
    type Target = Own;

    fn deref(&self) -> &Own {
        // SAFETY: only one call has the renderer, whose flag it has set.
        unsafe { &*self.0.own.get() }
    }
}

impl DerefMut for Borrowed<'_> {
    fn deref_mut(&mut self) -> &mut Own {
        // SAFETY: as above.
        unsafe { &mut *self.0.own.get() }
    }
}

impl Drop for Borrowed<'_> {
    fn drop(&mut self) {
        self.faulty |= std::thread::panicking();
        self.0.busy.store(false, Release);
    }
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

/// Version of this interface: functions and members are only added while it is the same.
pub const POINTILLIST_VERSION: u32 = 1;

/// Returns the version of the library's interface, to be compared with POINTILLIST_VERSION.
#[unsafe(no_mangle)]
pub extern "C" fn pointillist_version() -> u32 {
    POINTILLIST_VERSION
}

/// Returns the number of requirements.
#[unsafe(no_mangle)]
pub extern "C" fn pointillist_requirement_count() -> u32 {
    requirements().len() as u32
}

/// Returns a feature that a device must have, or that makes it faster, from 0 on. No extension is
/// needed beside Vulkan 1.3.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pointillist_requirement(
    number: u32,
    out: *mut PointillistRequirement,
    error: *mut PointillistError,
) -> PointillistResult {
    guarded(error, || {
        let all = requirements();
        let Some(found) = all.get(number as usize) else {
            let count = all.len();
            let what = format!("there is no requirement {number}: there are {count}, from 0 on");
            return Err(Error::Request(what));
        };
        let mut own = PointillistRequirement {
            required: found.required,
            ..PointillistRequirement::default()
        };
        copy(found.structure, &mut own.structure);
        copy(found.feature, &mut own.feature);
        copy(found.purpose, &mut own.purpose);
        // SAFETY: as the caller ensures.
        unsafe { give(own, out, "out") }
    })
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

/// Reads a host, and the options of its renderer.
///
/// # Safety
/// `host` is null or has as many bytes as it says.
unsafe fn read_host(host: *const PointillistHost) -> Result<(Host, RendererOptions)> {
    // SAFETY: as the caller ensures.
    let host = unsafe { sized(host, PointillistHost::default(), "host")? };
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
    Ok((host, options))
}

/// Returns a renderer for the caller to free.
fn boxed(renderer: Renderer) -> *mut PointillistRenderer {
    let own = UnsafeCell::new(Own { renderer, report: FrameReport::default(), faulty: false });
    Box::into_raw(Box::new(PointillistRenderer { own, busy: AtomicBool::new(false) }))
}

/// Makes a renderer on a host's device, and writes it to `out`.
///
/// # Safety
/// `host` is null or has as many bytes as it says, and `out` is null or valid.
unsafe fn make(
    host: *const PointillistHost,
    out: *mut *mut PointillistRenderer,
    made: impl FnOnce(&Host, RendererOptions) -> Result<Renderer>,
) -> Result<()> {
    if out.is_null() {
        return null("out");
    }
    // SAFETY: as the caller ensures.
    unsafe {
        let (host, options) = read_host(host)?;
        out.write(boxed(made(&host, options)?));
    }
    Ok(())
}

/// Creates a renderer on the host's device, which must outlive it.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pointillist_new(
    host: *const PointillistHost,
    out: *mut *mut PointillistRenderer,
    error: *mut PointillistError,
) -> PointillistResult {
    // SAFETY: the pointers and handles are valid, as the caller ensures.
    guarded(error, || unsafe { make(host, out, |host, options| Renderer::new(host, options)) })
}

/// Returns in `out` a renderer on another device, such as after the loss of one, with the clouds,
/// settings and filters of `renderer`. Ids of clouds stay the same. Files are read again; clouds of
/// the host's points have failed, to be removed and added again. The former renderer is to be freed
/// before its device is destroyed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pointillist_restore(
    renderer: *mut PointillistRenderer,
    host: *const PointillistHost,
    out: *mut *mut PointillistRenderer,
    error: *mut PointillistError,
) -> PointillistResult {
    // SAFETY: the pointers and handles are valid, as the caller ensures.
    guarded(error, || unsafe {
        make(host, out, |host, _| self::renderer(renderer)?.renderer.restored(host))
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

/// Adds points of a buffer of the host's device as a cloud. The next frame copies them; the buffer
/// is not changed until the device has completed it.
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

/// Moves a cloud: an affine matrix, column by column, from its coordinates to the host's world. It
/// may also stretch, shear and mirror the cloud, but not flatten it. Clip boxes are in the cloud's
/// own coordinates, lights in the host's world.
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

/// Sets style, effect, light, background, layer, opacity, clip, only, not, lod, budget, ramp,
/// range, brightness, contrast, gamma, time or error, as on the command line. `only` and `not` are
/// of clouds that are opened or added from then on; `lod` and `budget` are as in scene files.
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
            if !report.is_null() {
                room(report, "report")?;
            }
            let view = |number: usize| {
                // The caller's views are as far apart as it knows them.
                let first = frame.views.cast::<u8>();
                let apart = first.cast::<usize>().read_unaligned();
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
                copies_depth: flag(frame.copies_depth, "copies_depth")?,
                ids: optional(frame.ids, "ids")?,
                normals: optional(frame.normals, "normals")?,
            };
            let frame = Frame { number: frame.number, safe: frame.safe, targets, views: &views };
            let found = own.renderer.record(command_buffer, &frame)?;
            if !report.is_null() {
                let given = PointillistReport {
                    points: found.points,
                    missing: found.missing as u64,
                    streamed: found.streamed,
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

/// Takes back the last recorded frame, which the host neither has submitted nor will. The next
/// frame, of a greater number, uploads again what this one did, and answers its picks.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pointillist_drop_frame(
    renderer: *mut PointillistRenderer,
    number: u64,
    error: *mut PointillistError,
) -> PointillistResult {
    guarded(error, || {
        // SAFETY: as the caller ensures.
        unsafe { self::renderer(renderer)? }.renderer.drop_frame(number)
    })
}

/// Describes the last frame, line by line: how complete it is, the state of each cloud, which
/// effects run and why, device times of passes, errors. Writes as much of the text as `size` bytes
/// hold, which ends with 0, and to `length`, which may be NULL, the length of all of it.
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

/// Requests the point in a pixel of the next frame. Clouds are asked, and not the host's geometry
/// in front of them; the host compares depths.
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
        // An answer is given once, so it is not taken without a place for it.
        // SAFETY: as the caller ensures.
        unsafe { room(picked, "picked") }?;
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
                color: point.color.map_or([0; 4], |[r, g, b]| [r, g, b, 255]),
                value: point.value.unwrap_or(f64::NAN),
                depth: point.depth,
                ..PointillistPicked::default()
            },
        };
        // SAFETY: as the caller ensures.
        unsafe { give(found, picked, "picked") }
    })
}
