//! Recording into a host's command buffers: nothing is submitted, nothing waits.
//!
//! The host numbers its frames. Resources of a frame are held until it says that the device has
//! completed it.

use super::record::{self, Recorded};
use super::{Gpu, Graph, ResourceId};
use crate::error::Result;
use crate::gpu::{Device, HostDevice};
use ash::vk;

/// The frame being recorded, and those that the device may still be drawing.
#[derive(Default)]
pub(crate) struct HostQueue {
    pub commands: vk::CommandBuffer,
    pub frame: u64,
    /// Last frame that the device has completed.
    pub safe_frame: u64,
    /// Copies recorded before the picture of a frame.
    copies: Vec<(u64, Recorded)>,
}

/// Records a graph into the host's current command buffer, whose results nothing waits for.
/// Returns the number of the frame.
pub(super) fn record_detached(mut graph: Graph, wanted: &[ResourceId]) -> Result<u64> {
    let plan = graph.complete(wanted)?;
    let commands = graph.host().commands;
    let (recorded, gpu) = record::into_host(graph, plan, commands)?;
    let host = gpu.host.as_mut().expect("checked by host()");
    host.copies.push((host.frame, recorded));
    Ok(host.frame)
}

impl Graph<'_> {
    /// Returns the host, which the caller knows to be there.
    fn host(&self) -> &HostQueue {
        self.gpu.host.as_ref().expect("a graph for a host")
    }

    /// Records into the host's current command buffer. Outputs are download buffers and `wanted`.
    pub(crate) fn record_for_host(mut self, wanted: &[ResourceId]) -> Result<Recorded> {
        let plan = self.complete(wanted)?;
        let commands = self.host().commands;
        Ok(record::into_host(self, plan, commands)?.0)
    }
}

impl Gpu {
    /// Uses a host's device, and records into its command buffers.
    ///
    /// # Safety
    /// As for [`Device::adopt`].
    pub(crate) unsafe fn adopt(host: &HostDevice) -> Result<Gpu> {
        // SAFETY: as the caller ensures.
        let mut gpu = Gpu::on(unsafe { Device::adopt(host) }?)?;
        gpu.host = Some(HostQueue::default());
        Ok(gpu)
    }

    /// Begins a frame of the host. `safe_frame` is the last one that the device has completed.
    pub(crate) fn begin_host_frame(
        &mut self,
        commands: vk::CommandBuffer,
        frame: u64,
        safe_frame: u64,
    ) {
        let host = self.host.as_mut().expect("a device of a host");
        (host.commands, host.frame) = (commands, frame);
        host.safe_frame = host.safe_frame.max(safe_frame);
        let safe_frame = host.safe_frame;
        host.copies.retain(|(number, _)| *number > safe_frame);
        // Clouds are dropped when no frame uses them any more.
        self.memory.destroy_now();
    }

    /// Ends a frame of the host, whose number is that of the last submission from now on.
    pub(crate) fn end_host_frame(&mut self) {
        let host = self.host.as_mut().expect("a device of a host");
        (host.commands, self.submitted) = (vk::CommandBuffer::null(), host.frame);
    }
}
