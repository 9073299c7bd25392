//! Vulkan, and nothing about points.
//!
//! `device` finds and opens a device; `memory` makes named buffers and images and keeps freed ones for reuse; `kernel` makes compute
//! pipelines; `raster` those that rasterise; `timeline` counts what is done; `timing` reads timestamps; `breadcrumbs` says
//! which pass was running when a device was lost.

pub mod breadcrumbs;
pub mod device;
pub mod kernel;
pub mod memory;
pub mod raster;
pub mod timeline;
pub mod timing;

pub use device::{Device, DeviceOptions};
pub use kernel::{Access, Binding, Code, Kind};
pub use memory::{BufferDesc, ImageDesc, Memory, MemoryRequirements, Place};

use crate::error::Error;
use ash::vk;

/// `call.map_err(failed("vkQueueSubmit2"))`.
pub fn failed(during: &str) -> impl FnOnce(vk::Result) -> Error + '_ {
    move |code| Error::Vulkan { during: during.to_string(), code: format!("{code:?}") }
}
