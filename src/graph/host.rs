//! Recording into a host's command buffers: nothing is submitted, nothing waits.
//!
//! The host numbers its frames. Resources of a frame are held until it says that the device has
//! completed it.

use super::record::{self, Recorded};
use super::{Answer, Buffer, Gpu, Graph, ResourceId};
use crate::error::{Error, Result};
use crate::gpu::{Device, HostDevice};
use ash::vk;
use std::sync::Arc;

/// The frame being recorded, and those that the device may still be drawing.
#[derive(Default)]
pub(crate) struct HostQueue {
    pub commands: vk::CommandBuffer,
    pub frame: u64,
    /// Last frame that the device has completed.
    pub safe_frame: u64,
    /// Commands recorded before the picture of a frame.
    before: Vec<Arc<Before>>,
}

/// Commands recorded before a picture, whose results a later frame may read.
struct Before {
    name: String,
    frame: u64,
    recorded: Recorded,
    read: Vec<Buffer>,
}

/// What earlier frames of a picture asked the device, by name.
#[derive(Clone, Default)]
pub(crate) struct Answers(Vec<Arc<Before>>);

impl Answers {
    /// Returns the answer to a question of an earlier frame, if the device has completed it;
    /// records the question if it is new.
    pub(super) fn ask(
        &mut self,
        graph: &mut Graph,
        name: &str,
        record: impl FnOnce(&mut Graph) -> Result<Vec<Buffer>>,
    ) -> Result<Option<Answer>> {
        if let Some(asked) = self.0.iter().find(|asked| asked.name == name) {
            if asked.frame > graph.host().safe_frame {
                return Ok(None);
            }
            let words = |buffer: &Buffer| asked.recorded.read::<u32>(buffer).to_vec();
            let milliseconds = asked.recorded.times()?.map(|(_, ms)| ms).sum();
            return Ok(Some(Answer {
                words: asked.read.iter().map(words).collect(),
                milliseconds,
            }));
        }
        let mut before = graph.preceding();
        let read = record(&mut before)?;
        self.0.push(hold(before, name, read, &[])?);
        Ok(None)
    }
}

/// Records a graph into the host's current command buffer, and holds it until the frame is
/// complete.
fn hold(
    mut graph: Graph,
    name: &str,
    read: Vec<Buffer>,
    wanted: &[ResourceId],
) -> Result<Arc<Before>> {
    let plan = graph.complete(wanted)?;
    let commands = graph.host().commands;
    let (recorded, gpu) = record::into_host(graph, plan, commands)?;
    let host = gpu.host.as_mut().expect("checked by host()");
    let before = Arc::new(Before { name: name.into(), frame: host.frame, recorded, read });
    host.before.push(before.clone());
    Ok(before)
}

/// Records a graph into the host's current command buffer, whose results nothing waits for.
/// Returns the number of the frame.
pub(super) fn record_detached(graph: Graph, wanted: &[ResourceId]) -> Result<u64> {
    Ok(hold(graph, "detached", Vec::new(), wanted)?.frame)
}

/// Returns the error of a submission that would have to be waited for.
pub(super) fn refused() -> Error {
    Error::Request(
        "this needs results of the device while a frame is recorded, which a host's queue does not allow".into(),
    )
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
        host.before.retain(|before| before.frame > safe_frame);
        self.memory.begin_frame(frame, safe_frame);
    }

    /// Returns the command buffer of the host's frame.
    pub(crate) fn host_commands(&self) -> vk::CommandBuffer {
        self.host.as_ref().expect("a device of a host").commands
    }

    /// Ends a frame of the host, whose number is that of the last submission from now on. Returns
    /// the number of the one before.
    pub(crate) fn end_host_frame(&mut self) -> u64 {
        let host = self.host.as_mut().expect("a device of a host");
        host.commands = vk::CommandBuffer::null();
        std::mem::replace(&mut self.submitted, host.frame)
    }

    /// Ends a frame of the host whose commands are never submitted; `last` is the number of the
    /// last submission.
    pub(crate) fn drop_host_frame(&mut self, last: u64) {
        self.host.as_mut().expect("a device of a host").commands = vk::CommandBuffer::null();
        self.submitted = last;
        // Their contents may be those of the frame.
        self.memory.invalidate_all();
    }

    /// Returns the last frame that is completed, if the device has completed `safe_frame`, and
    /// `next` is the next one. Frames that were dropped are completed with those before them.
    pub(crate) fn completed_frame(&self, safe_frame: u64, next: u64) -> u64 {
        if self.submitted <= safe_frame { next - 1 } else { safe_frame }
    }
}
