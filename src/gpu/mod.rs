//! Vulkan objects, independent of points.
//!
//! `device` finds and opens a device, or uses a host's; `logical_device` has its functions;
//! `requirements` lists what it must have, and `drivers` what to install; `memory` creates named
//! buffers and images and recycles freed ones; `kernel` creates compute pipelines and `raster`
//! graphics pipelines; `timeline` wraps a timeline semaphore; `timing` reads timestamps;
//! `breadcrumbs` names the pass that was running when a device was lost.

pub mod breadcrumbs;
pub mod device;
mod drivers;
pub mod kernel;
pub mod logical_device;
pub mod memory;
pub mod raster;
pub mod requirements;
pub mod timeline;
pub mod timing;

pub use device::{Device, DeviceOptions, HostDevice, MemoryFunctions, TestOverrides};
pub use kernel::{Access, Binding, Code, Kind};
pub use logical_device::LogicalDevice;
pub use memory::{BufferDesc, ImageDesc, Memory, MemoryRequirements, Place};

use crate::error::Error;
use ash::vk;

/// Converts a `vk::Result` to an error: `call.map_err(failed("vkQueueSubmit2"))`.
pub fn failed(during: &str) -> impl FnOnce(vk::Result) -> Error + '_ {
    move |code| Error::Vulkan { during: during.to_string(), code: code.as_raw() }
}
