//! A Vulkan device's functions, with the allocation callbacks of the application that made it.

use ash::vk;
use std::ops::Deref;

/// The functions of a device, and the host's callbacks for the CPU memory of its objects. Device
/// memory is allocated without them.
#[derive(Clone)]
pub struct LogicalDevice {
    functions: ash::Device,
    callbacks: Option<vk::AllocationCallbacks<'static>>,
}

// SAFETY: Vulkan calls callbacks on the thread of the call, which hosts are told to allow.
unsafe impl Send for LogicalDevice {}
// SAFETY: as above.
unsafe impl Sync for LogicalDevice {}

impl LogicalDevice {
    pub fn new(
        functions: ash::Device,
        callbacks: Option<vk::AllocationCallbacks<'static>>,
    ) -> LogicalDevice {
        LogicalDevice { functions, callbacks }
    }

    /// Returns the callbacks, for every call that makes or destroys an object.
    pub fn callbacks(&self) -> Option<&vk::AllocationCallbacks<'static>> {
        self.callbacks.as_ref()
    }
}

impl Deref for LogicalDevice {
    type Target = ash::Device;

    fn deref(&self) -> &ash::Device {
        &self.functions
    }
}
