//! Arguments of the interface for C, which may hold anything, and its outputs.

use super::structs::{PointillistAccess, PointillistPreset, PointillistTarget};
use super::{Borrowed, PointillistRenderer, PointillistResult};
use crate::error::{Error, Result};
use crate::renderer::{Access, Preset, Target};
use std::ffi::{CStr, c_char};
use std::panic::resume_unwind;
use std::sync::atomic::Ordering::Acquire;

/// Copies text, as much as there is room for, and ends it with 0.
pub(super) fn copy(text: &str, to: &mut [c_char]) {
    let Some(most) = to.len().checked_sub(1) else { return };
    let cut = (0..=text.len().min(most)).rev().find(|at| text.is_char_boundary(*at));
    let bytes = &text.as_bytes()[..cut.unwrap_or(0)];
    to.fill(0);
    to.iter_mut().zip(bytes).for_each(|(to, from)| *to = *from as c_char);
}

pub(super) fn code(error: &Error) -> PointillistResult {
    match error {
        _ if error.is_lost_device() => PointillistResult::DeviceLost,
        Error::Request(_) | Error::Interrupted => PointillistResult::Request,
        Error::Io { .. } | Error::Format { .. } => PointillistResult::File,
        Error::Device(_) | Error::Vulkan { .. } | Error::Validation(_) => PointillistResult::Device,
    }
}

pub(super) fn null<T>(name: &str) -> Result<T> {
    Err(Error::Request(format!("{name} is null")))
}

/// Reads a struct that begins with its size; members that the caller does not know are `default`.
///
/// # Safety
/// `from` is null or has as many bytes as it says.
pub(super) unsafe fn sized<T: Copy>(from: *const T, default: T, name: &str) -> Result<T> {
    let mut value = default;
    // SAFETY: every such struct begins with its size, and has that many bytes.
    unsafe {
        let bytes = room(from, name)?.min(size_of::<T>());
        std::ptr::copy_nonoverlapping(from.cast::<u8>(), (&raw mut value).cast::<u8>(), bytes);
    }
    Ok(value)
}

/// Returns the size of a caller's struct. Errors if it is null, or has none.
///
/// # Safety
/// `of` is null or begins with a size.
pub(super) unsafe fn room<T>(of: *const T, name: &str) -> Result<usize> {
    if of.is_null() {
        return null(name);
    }
    // SAFETY: as the caller ensures.
    let size = unsafe { of.cast::<usize>().read_unaligned() };
    if size < size_of::<usize>() || size > 1 << 16 {
        let what = format!("{name} has the size {size}; make it with its _default function");
        return Err(Error::Request(what));
    }
    Ok(size)
}

/// Writes a struct that begins with its size, as far as the caller knows it.
///
/// # Safety
/// As for [`sized`].
pub(super) unsafe fn give<T: Copy>(value: T, to: *mut T, name: &str) -> Result<()> {
    // SAFETY: as the caller ensures.
    unsafe {
        let size = room(to, name)?;
        let bytes = size.min(size_of::<T>());
        std::ptr::copy_nonoverlapping((&raw const value).cast::<u8>(), to.cast::<u8>(), bytes);
        to.cast::<usize>().write_unaligned(size);
    }
    Ok(())
}

/// Reads a choice of the caller. In C it is `true` or `false`, but memory may hold anything.
pub(super) fn flag(value: u8, name: &str) -> Result<bool> {
    match value {
        0 | 1 => Ok(value == 1),
        _ => Err(Error::Request(format!("{name} is {value}; give 0 or 1"))),
    }
}

/// Reads a preset of the caller.
pub(super) fn preset(value: i32) -> Result<Preset> {
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
/// Errors if another call has it.
///
/// # Safety
/// `renderer` is null, or from [`pointillist_new`] and not freed.
pub(super) unsafe fn renderer<'r>(renderer: *mut PointillistRenderer) -> Result<Borrowed<'r>> {
    // SAFETY: as the caller ensures.
    let renderer = unsafe { renderer.as_ref() }.map_or_else(|| null("renderer"), Ok)?;
    if renderer.busy.swap(true, Acquire) {
        return Err(Error::Request(
            "the renderer is in another call, of another thread or around this one; wait for its end".into(),
        ));
    }
    let own = Borrowed(renderer);
    if own.faulty {
        resume_unwind(Box::new("an earlier call ended in a panic"));
    }
    Ok(own)
}

/// # Safety
/// `text` is null or ends with 0.
pub(super) unsafe fn words<'t>(text: *const c_char, name: &str) -> Result<&'t str> {
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
pub(super) unsafe fn array<'a, T>(first: *const T, count: usize) -> Result<Option<&'a [T]>> {
    if count > isize::MAX as usize / size_of::<T>().max(1) {
        return Err(Error::Request(format!("an array of {count} items; memory ends before")));
    }
    // SAFETY: as the caller ensures.
    Ok((!first.is_null()).then(|| unsafe { std::slice::from_raw_parts(first, count) }))
}

pub(super) fn target(target: &PointillistTarget) -> Result<Target> {
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
