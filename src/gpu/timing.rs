//! GPU timestamps: one pair per pass, read as milliseconds.

use super::{Device, LogicalDevice, failed};
use crate::error::Result;
use ash::vk;

/// Timestamps of one submission; all times are 0 on a queue without timestamps.
pub struct Timing {
    device: LogicalDevice,
    /// Null without timestamps.
    pool: vk::QueryPool,
    passes: u32,
    nanoseconds_per_tick: f64,
}

impl Timing {
    pub fn new(device: &Device, passes: u32) -> Result<Timing> {
        let info = vk::QueryPoolCreateInfo::default()
            .query_type(vk::QueryType::TIMESTAMP)
            .query_count(2 * passes.max(1));
        let mut pool = vk::QueryPool::null();
        if device.has_timestamps {
            // SAFETY: a plain creation on a live device.
            pool = unsafe { device.raw.make(&info) }?.keep();
            device.name(pool, "timing");
        }
        Ok(Timing {
            device: device.raw.clone(),
            pool,
            passes,
            nanoseconds_per_tick: device.limits.timestamp_period as f64,
        })
    }

    /// Resets the queries; call before the first pass.
    pub fn reset(&self, commands: vk::CommandBuffer) {
        if self.pool == vk::QueryPool::null() {
            return;
        }
        // SAFETY: recorded outside of rendering into a command buffer that is being recorded.
        unsafe { self.device.cmd_reset_query_pool(commands, self.pool, 0, 2 * self.passes.max(1)) };
    }

    pub fn mark(&self, commands: vk::CommandBuffer, pass: usize, end: bool) {
        if self.pool == vk::QueryPool::null() {
            return;
        }
        let stage = vk::PipelineStageFlags2::ALL_COMMANDS;
        // SAFETY: `pass` is below the count that the pool was made for.
        unsafe {
            self.device.cmd_write_timestamp2(
                commands,
                stage,
                self.pool,
                2 * pass as u32 + end as u32,
            )
        };
    }

    /// Returns the time of each pass `[ms]` once the submission has completed; 0 if it was never
    /// submitted. Nothing is waited for.
    pub fn read(&self) -> Result<Vec<f64>> {
        let mut ticks = vec![0u64; 2 * self.passes as usize];
        if ticks.is_empty() || self.pool == vk::QueryPool::null() {
            return Ok(vec![0.0; self.passes as usize]);
        }
        let flags = vk::QueryResultFlags::TYPE_64;
        // SAFETY: the pool has as many queries.
        match unsafe { self.device.get_query_pool_results(self.pool, 0, &mut ticks, flags) } {
            // What was written of some is told of none.
            Err(vk::Result::NOT_READY) => ticks.fill(0),
            read => read.map_err(failed("vkGetQueryPoolResults"))?,
        }
        Ok(ticks
            .chunks(2)
            .map(|pair| pair[1].saturating_sub(pair[0]) as f64 * self.nanoseconds_per_tick / 1e6)
            .collect())
    }
}

impl Drop for Timing {
    fn drop(&mut self) {
        // SAFETY: the submission that used the pool has been waited for.
        unsafe { self.device.destroy(self.pool) };
    }
}
