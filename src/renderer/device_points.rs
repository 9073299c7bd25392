//! Points in a buffer of the host's device: copied by a frame, and read when it is complete.

use crate::cloud::points::{Points, Positions};
use crate::error::{Error, Result};
use crate::gpu::memory::RawBuffer;
use crate::gpu::{BufferDesc, Place};
use crate::graph::Gpu;
use ash::vk::{self, Handle};

/// Points in a buffer of the host's device. The buffer is not changed from the next frame on, until
/// the device has completed it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PointBuffer {
    /// `VkBuffer`, with usage as source of transfers, of the renderer's queue family.
    pub buffer: u64,
    /// Place of the first point `[bytes]`, a multiple of 4.
    pub offset: u64,
    /// Distance from point to point `[bytes]`, a multiple of 4. A point begins with x, y and z,
    /// f32, world `[m]`.
    pub stride: u32,
    /// Number of points.
    pub count: u32,
    /// Place of red, green and blue within a point, a byte each, sRGB `[bytes]`; without colours if
    /// `None`.
    pub color_offset: Option<u32>,
}

impl PointBuffer {
    /// Errors if its numbers make no sense.
    pub(super) fn check(&self) -> Result<()> {
        let room = self.color_offset.map_or(12, |offset| offset.saturating_add(3).max(12));
        let aligned = self.offset.is_multiple_of(4) && self.stride.is_multiple_of(4);
        match self.buffer != 0 && self.count > 0 && aligned && self.stride >= room {
            true => Ok(()),
            false => Err(Error::Request(format!(
                "a buffer of points needs a handle, at least one point, and a stride of at least {room} bytes; offset and stride are multiples of 4"
            ))),
        }
    }

    fn bytes(&self) -> u64 {
        self.stride as u64 * self.count as u64
    }

    /// Records a copy into the host's current command buffer.
    pub(super) fn record_copy(&self, gpu: &mut Gpu) -> Result<RawBuffer> {
        let desc = BufferDesc { bytes: self.bytes(), place: Place::Download };
        let Gpu { memory, device, .. } = gpu;
        let copy = memory.buffer(device, desc, "points of a buffer")?;
        let commands = gpu.host_commands();
        use vk::{AccessFlags2 as Access, PipelineStageFlags2 as Stage};
        let barrier = |from: (Stage, Access), to: (Stage, Access)| {
            vk::MemoryBarrier2::default()
                .src_stage_mask(from.0)
                .src_access_mask(from.1)
                .dst_stage_mask(to.0)
                .dst_access_mask(to.1)
        };
        let before = [barrier(
            (Stage::ALL_COMMANDS, Access::MEMORY_WRITE),
            (Stage::COPY, Access::TRANSFER_READ),
        )];
        let after =
            [barrier((Stage::COPY, Access::TRANSFER_WRITE), (Stage::HOST, Access::HOST_READ))];
        let region = vk::BufferCopy { src_offset: self.offset, dst_offset: 0, size: self.bytes() };
        let raw = &gpu.device.raw;
        // SAFETY: the command buffer is being recorded; the host ensures that its buffer is alive,
        // and the copy lives until the frame is complete.
        unsafe {
            let wait = vk::DependencyInfo::default().memory_barriers(&before);
            raw.cmd_pipeline_barrier2(commands, &wait);
            raw.cmd_copy_buffer(commands, vk::Buffer::from_raw(self.buffer), copy.raw, &[region]);
            let wait = vk::DependencyInfo::default().memory_barriers(&after);
            raw.cmd_pipeline_barrier2(commands, &wait);
        }
        Ok(copy)
    }

    /// Calls `take` with the points of a completed copy.
    pub(super) fn read<T>(&self, copy: &RawBuffer, take: impl FnOnce(&Points) -> T) -> T {
        let bytes = &copy.bytes()[..self.bytes() as usize];
        let points = || bytes.chunks_exact(self.stride as usize);
        let places: Vec<[f32; 3]> =
            points().map(|point| bytemuck::pod_read_unaligned(&point[..12])).collect();
        let colors = self.color_offset.map(|offset| {
            let of_point = |point: &[u8]| {
                let first = offset as usize;
                [point[first], point[first + 1], point[first + 2]]
            };
            points().map(of_point).collect::<Vec<_>>()
        });
        take(&Points { colors: colors.as_deref(), ..Points::new(Positions::F32(&places)) })
    }
}
