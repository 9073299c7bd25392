//! Breadcrumbs: the pass that was running when the device was lost.
//!
//! A mapped buffer holds one word per pass, written before the pass starts. After a loss, the last
//! written word names the pass.

use super::Device;
use super::memory::{BufferDesc, Memory, Place, RawBuffer};
use crate::error::{Error, Result};
use ash::vk;

const CRUMB: u32 = 0xC0DE;

pub struct Breadcrumbs {
    crumbs: RawBuffer,
    names: Vec<String>,
}

impl Breadcrumbs {
    pub fn new(device: &Device, memory: &mut Memory, names: Vec<String>) -> Result<Breadcrumbs> {
        let desc = BufferDesc {
            bytes: (4 * names.len() as u64).next_power_of_two().max(256),
            place: Place::Download,
        };
        let mut crumbs = memory.buffer(device, desc, "breadcrumbs")?;
        crumbs.bytes_mut().fill(0);
        Ok(Breadcrumbs { crumbs, names })
    }

    pub fn mark(&self, device: &Device, commands: vk::CommandBuffer, pass: usize) {
        // SAFETY: the word lies within the buffer, which lives until the submission has been waited
        // for.
        unsafe { device.raw.cmd_fill_buffer(commands, self.crumbs.raw, 4 * pass as u64, 4, CRUMB) };
    }

    /// Returns the error of a submission that failed with `code`.
    pub fn blame(&self, code: vk::Result) -> Error {
        let words: &[u32] = bytemuck::cast_slice(&self.crumbs.bytes()[..4 * self.names.len()]);
        let during = match words.iter().rposition(|&word| word == CRUMB) {
            Some(pass) => format!("pass {}", self.names[pass]),
            None => "submission".to_string(),
        };
        Error::Vulkan { during, code: code.as_raw() }
    }
}
