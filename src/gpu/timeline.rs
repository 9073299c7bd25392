//! A counter that threads and the device raise and read: a timeline semaphore.

use super::memory::LifetimeGuard;
use super::{Device, LogicalDevice, failed};
use crate::error::Result;
use ash::vk;
use std::sync::Mutex;

/// A timeline semaphore. Any thread may raise it, even after the device is gone.
pub struct Timeline {
    pub raw: vk::Semaphore,
    device: LogicalDevice,
    alive: LifetimeGuard,
    // Held during both calls: the validation layers (1.3.239) stall for ten seconds when a value is
    // read while it is being raised.
    call: Mutex<()>,
}

impl Timeline {
    pub fn new(device: &Device, alive: &LifetimeGuard, name: &str) -> Result<Timeline> {
        let mut kind =
            vk::SemaphoreTypeCreateInfo::default().semaphore_type(vk::SemaphoreType::TIMELINE);
        let info = vk::SemaphoreCreateInfo::default().push_next(&mut kind);
        // SAFETY: a plain creation on a live device, which has timeline semaphores (`device`
        // requires them).
        let raw = unsafe { device.raw.make(&info) }?.keep();
        device.name(raw, name);
        Ok(Timeline { raw, device: device.raw.clone(), alive: alive.child(), call: Mutex::new(()) })
    }

    /// Destroys the semaphore; later calls on remaining handles are no-ops. Submissions that signal
    /// it must have been waited for.
    pub fn end(&self) {
        // SAFETY: the device is alive, no thread uses the semaphore, and it is destroyed once.
        self.alive.close(|| unsafe { self.device.destroy(self.raw) });
    }

    /// Raises the counter; values must grow.
    pub fn signal(&self, value: u64) -> Result<()> {
        let _alone = self.call.lock();
        self.alive.with_alive((), || {
            let info = vk::SemaphoreSignalInfo::default().semaphore(self.raw).value(value);
            // SAFETY: the device and the semaphore are alive.
            unsafe { self.device.signal_semaphore(&info) }.map_err(failed("vkSignalSemaphore"))
        })
    }

    pub fn value(&self) -> Result<u64> {
        let _alone = self.call.lock();
        self.alive.with_alive(u64::MAX, || {
            // SAFETY: as above.
            unsafe { self.device.get_semaphore_counter_value(self.raw) }
                .map_err(failed("vkGetSemaphoreCounterValue"))
        })
    }
}

impl Drop for Timeline {
    fn drop(&mut self) {
        self.end();
    }
}
