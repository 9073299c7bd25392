//! A submission to our own queue, waited for by a fence.

use super::Gpu;
use crate::error::Result;
use crate::gpu::breadcrumbs::Breadcrumbs;
use crate::gpu::{LogicalDevice, failed};
use ash::vk;
use std::cell::Cell;

/// A submission of ours: command buffer and fence.
pub(super) struct Submission {
    device: LogicalDevice,
    command_pool: vk::CommandPool,
    pub commands: vk::CommandBuffer,
    fence: vk::Fence,
    in_flight: Cell<bool>,
}

impl Submission {
    pub fn new(gpu: &Gpu) -> Result<Submission> {
        let device = &gpu.device.raw;
        let pool_info = vk::CommandPoolCreateInfo::default()
            .queue_family_index(gpu.device.family)
            .flags(vk::CommandPoolCreateFlags::TRANSIENT);
        // SAFETY: plain creations on a live device, destroyed in `drop`.
        unsafe {
            let command_pool = device.make(&pool_info)?;
            let commands = device
                .allocate_command_buffers(
                    &vk::CommandBufferAllocateInfo::default()
                        .command_pool(*command_pool)
                        .command_buffer_count(1),
                )
                .map_err(failed("vkAllocateCommandBuffers"))?[0];
            let fence = device.make(&vk::FenceCreateInfo::default())?.keep();
            Ok(Submission {
                command_pool: command_pool.keep(),
                commands,
                fence,
                in_flight: Cell::new(false),
                device: device.clone(),
            })
        }
    }

    pub fn begin(&self) -> Result<()> {
        let info = vk::CommandBufferBeginInfo::default()
            .flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        // SAFETY: a fresh command buffer.
        unsafe { self.device.begin_command_buffer(self.commands, &info) }
            .map_err(failed("vkBeginCommandBuffer"))
    }

    /// Submits what has been recorded, waits, and continues recording. Pages return to the loader
    /// only after the last submission.
    pub fn flush(&self, gpu: &Gpu, breadcrumbs: &Breadcrumbs) -> Result<()> {
        self.submit(gpu, breadcrumbs, &[])?;
        self.wait(breadcrumbs)?;
        // SAFETY: the submission has been waited for.
        unsafe {
            self.device.reset_fences(&[self.fence]).map_err(failed("vkResetFences"))?;
            self.device
                .reset_command_pool(self.command_pool, vk::CommandPoolResetFlags::empty())
                .map_err(failed("vkResetCommandPool"))?;
        }
        self.begin()
    }

    /// Submits the remaining commands and raises the timeline.
    pub fn submit_rest(&self, gpu: &mut Gpu, breadcrumbs: &Breadcrumbs) -> Result<()> {
        gpu.submitted += 1;
        let passed = [vk::SemaphoreSubmitInfo::default()
            .semaphore(gpu.completed.raw)
            .value(gpu.submitted)
            .stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)];
        self.submit(gpu, breadcrumbs, &passed)
    }

    pub fn is_done(&self) -> bool {
        // SAFETY: the fence is alive and was submitted. `wait` reports a lost device.
        let status = unsafe { self.device.get_fence_status(self.fence) };
        status != Ok(false)
    }

    /// Waits for the fence; the error of a lost device names the pass that was running.
    pub fn wait(&self, breadcrumbs: &Breadcrumbs) -> Result<()> {
        // SAFETY: the fence is alive and was submitted.
        let waited = unsafe { self.device.wait_for_fences(&[self.fence], true, u64::MAX) };
        self.in_flight.set(false);
        if waited.is_err() {
            // A wait may fail for lack of memory, too, and what the device uses is freed next. A
            // lost device is idle.
            // SAFETY: no other thread uses the device's queue.
            let _ = unsafe { self.device.device_wait_idle() };
        }
        waited.map_err(|code| breadcrumbs.blame(code))
    }

    fn submit(
        &self,
        gpu: &Gpu,
        breadcrumbs: &Breadcrumbs,
        signals: &[vk::SemaphoreSubmitInfo],
    ) -> Result<()> {
        let commands = [vk::CommandBufferSubmitInfo::default().command_buffer(self.commands)];
        let submission = vk::SubmitInfo2::default()
            .command_buffer_infos(&commands)
            .signal_semaphore_infos(signals);
        // SAFETY: the command buffer is complete, and all it uses lives until the fence has been
        // waited for.
        unsafe {
            self.device.end_command_buffer(self.commands).map_err(failed("vkEndCommandBuffer"))?;
            self.device
                .queue_submit2(gpu.device.own_queue(), &[submission], self.fence)
                .map_err(|code| breadcrumbs.blame(code))?;
        }
        self.in_flight.set(true);
        Ok(())
    }
}

impl Drop for Submission {
    fn drop(&mut self) {
        // SAFETY: nothing is in flight after the wait. A lost device has nothing in flight.
        unsafe {
            if self.in_flight.get() {
                let _ = self.device.wait_for_fences(&[self.fence], true, u64::MAX);
            }
            self.device.destroy(self.fence);
            self.device.destroy(self.command_pool);
        }
    }
}
