//! A counter that threads and the device both raise and read: a timeline semaphore.

use super::memory::LifetimeGuard;
use super::{Device, failed};
use crate::error::Result;
use ash::vk;
use std::sync::Mutex;

/// May be raised from any thread, also from one that learns late that the device is gone.
pub struct Timeline {
    pub raw: vk::Semaphore,
    device: ash::Device,
    alive: LifetimeGuard,
    // Held for either call: the validation layers (1.3.239) stall for ten seconds over a value that is read while it is being raised.
    call: Mutex<()>,
}

impl Timeline {
    pub fn new(device: &Device, alive: &LifetimeGuard, name: &str) -> Result<Timeline> {
        let mut kind =
            vk::SemaphoreTypeCreateInfo::default().semaphore_type(vk::SemaphoreType::TIMELINE);
        let info = vk::SemaphoreCreateInfo::default().push_next(&mut kind);
        // SAFETY: a plain creation on a live device that has timeline semaphores (device.rs asks for them).
        let raw = unsafe { device.raw.create_semaphore(&info, None) }
            .map_err(failed("vkCreateSemaphore"))?;
        device.name(raw, name);
        Ok(Timeline { raw, device: device.raw.clone(), alive: alive.child(), call: Mutex::new(()) })
    }

    /// From now on it counts nothing, whoever still has it; submissions that raise the counter are waited for.
    pub fn end(&self) {
        // SAFETY: the device is alive, nobody is at work with the semaphore, and it is destroyed once.
        self.alive.close(|| unsafe { self.device.destroy_semaphore(self.raw, None) });
    }

    /// Raises the counter; values only ever grow.
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
