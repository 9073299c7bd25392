//! Compute pipelines from SPIR-V and its reflected bindings, one for each set of specialisation
//! constants.

use super::{Device, LogicalDevice};
use crate::error::Result;
use crate::thread_pool::Workers;
use ash::vk;
use rayon::prelude::*;
use std::collections::{BTreeMap, HashMap};

/// How a shader accesses a binding.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    Read,
    /// Overwrites all of it; previous contents do not matter.
    Write,
    Modify,
}

/// Type of a binding; that of an image names its format, which the bound image must have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Buffer,
    /// A buffer read as 32-bit words by texel fetches, which software devices gather ten times
    /// faster than from storage buffers.
    TexelsR32ui,
    /// Four words per texel, else like [`Kind::TexelsR32ui`].
    TexelsRgba32ui,
    R32f,
    R32ui,
    Rgba32f,
}

impl Kind {
    pub fn format(self) -> Option<vk::Format> {
        match self {
            Kind::Buffer | Kind::TexelsR32ui | Kind::TexelsRgba32ui => None,
            Kind::R32f => Some(vk::Format::R32_SFLOAT),
            Kind::R32ui => Some(vk::Format::R32_UINT),
            Kind::Rgba32f => Some(vk::Format::R32G32B32A32_SFLOAT),
        }
    }
}

#[derive(Clone, Copy, Debug)]
pub struct Binding {
    pub name: &'static str,
    pub bind: u32,
    pub kind: Kind,
    pub access: Access,
}

/// A compiled shader with its reflection.
#[derive(Clone, Copy, Debug)]
pub struct Code {
    pub name: &'static str,
    /// Words of SPIR-V in the byte order of the machine.
    pub spirv: &'static [u8],
    pub bindings: &'static [Binding],
    pub push_bytes: u32,
    /// Workgroup size; `[0, 0, 0]` if specialisation constant 0 is the width.
    pub workgroup: [u32; 3],
    /// The constant that enables a tile list, for shaders that include glsl/lib/tile_mask.glsl; the
    /// list is then the last binding.
    pub listed: Option<u32>,
}

impl Code {
    pub fn words(&self) -> Vec<u32> {
        bytemuck::pod_collect_to_vec(self.spirv)
    }
}

/// A compute pipeline with its layouts.
pub struct Kernel {
    pub pipeline: vk::Pipeline,
    pub layout: vk::PipelineLayout,
    pub set_layout: vk::DescriptorSetLayout,
}

/// Cache of kernels by shader and specialisation constants.
pub struct Kernels {
    device: LogicalDevice,
    made: HashMap<(&'static str, Constants), Kernel>,
}

/// Specialisation constants by id.
pub type Constants = Vec<(u32, u32)>;

impl Kernels {
    pub fn new(device: &Device) -> Kernels {
        Kernels { device: device.raw.clone(), made: HashMap::new() }
    }

    /// Makes the kernels that are missing on all threads: compiling one takes some milliseconds.
    pub fn prepare<'c>(
        &mut self,
        device: &Device,
        workers: &Workers,
        wanted: impl Iterator<Item = (&'c Code, &'c Constants)>,
    ) -> Result<()> {
        let missing = wanted.map(|(code, constants)| ((code.name, constants.clone()), code));
        let missing: BTreeMap<_, _> =
            missing.filter(|(key, _)| !self.made.contains_key(key)).collect();
        if missing.is_empty() {
            return Ok(());
        }
        let made: Vec<_> = workers.run(|| {
            missing
                .into_par_iter()
                .map(|(key, code)| make(device, code, &key.1).map(|kernel| (key, kernel)))
                .collect()
        });
        // Kernels made before or after one that failed are kept, too.
        let keep = |kernel: Result<_>| kernel.map(|kernel| self.made.extend([kernel]));
        made.into_iter().map(keep).fold(Ok(()), Result::and)
    }

    pub fn get(
        &mut self,
        device: &Device,
        code: &Code,
        constants: &[(u32, u32)],
    ) -> Result<&Kernel> {
        let key = (code.name, constants.to_vec());
        if !self.made.contains_key(&key) {
            let kernel = make(device, code, constants)?;
            self.made.insert(key.clone(), kernel);
        }
        Ok(&self.made[&key])
    }
}

impl Drop for Kernels {
    fn drop(&mut self) {
        for kernel in self.made.values() {
            // SAFETY: every submission has been waited for, so no kernel is in use.
            unsafe {
                self.device.destroy(kernel.pipeline);
                self.device.destroy(kernel.layout);
                self.device.destroy(kernel.set_layout);
            }
        }
    }
}

fn make(device: &Device, code: &Code, constants: &[(u32, u32)]) -> Result<Kernel> {
    let bindings: Vec<_> = code
        .bindings
        .iter()
        .map(|binding| {
            vk::DescriptorSetLayoutBinding::default()
                .binding(binding.bind)
                .descriptor_count(1)
                .stage_flags(vk::ShaderStageFlags::COMPUTE)
                .descriptor_type(descriptor_type(binding.kind))
        })
        .collect();
    let entries: Vec<_> = (0..constants.len())
        .map(|i| vk::SpecializationMapEntry {
            constant_id: constants[i].0,
            offset: 4 * i as u32,
            size: 4,
        })
        .collect();
    let values: Vec<u32> = constants.iter().map(|&(_, value)| value).collect();
    let specialization =
        vk::SpecializationInfo::default().map_entries(&entries).data(bytemuck::cast_slice(&values));
    let push = [vk::PushConstantRange {
        stage_flags: vk::ShaderStageFlags::COMPUTE,
        offset: 0,
        size: code.push_bytes,
    }];
    let raw = &device.raw;
    // SAFETY: all pointers outlive their calls; build.rs made the SPIR-V from this repository's
    // GLSL, and the layout from its reflection.
    unsafe {
        let set_layout =
            raw.make(&vk::DescriptorSetLayoutCreateInfo::default().bindings(&bindings))?;
        let set_layouts = [*set_layout];
        let mut layout_info = vk::PipelineLayoutCreateInfo::default().set_layouts(&set_layouts);
        if code.push_bytes > 0 {
            layout_info = layout_info.push_constant_ranges(&push);
        }
        let layout = raw.make(&layout_info)?;
        let module = raw.make(&vk::ShaderModuleCreateInfo::default().code(&code.words()))?;
        let stage = vk::PipelineShaderStageCreateInfo::default()
            .stage(vk::ShaderStageFlags::COMPUTE)
            .module(*module)
            .name(c"main")
            .specialization_info(&specialization);
        // A software device may run a pass in several dispatches.
        let flags = match device.is_cpu {
            true => vk::PipelineCreateFlags::DISPATCH_BASE,
            false => vk::PipelineCreateFlags::empty(),
        };
        let info =
            vk::ComputePipelineCreateInfo::default().flags(flags).stage(stage).layout(*layout);
        let pipeline = raw.make(&info)?.keep();
        device.name(pipeline, code.name);
        Ok(Kernel { pipeline, layout: layout.keep(), set_layout: set_layout.keep() })
    }
}

pub fn descriptor_type(kind: Kind) -> vk::DescriptorType {
    match kind {
        Kind::Buffer => vk::DescriptorType::STORAGE_BUFFER,
        Kind::TexelsR32ui | Kind::TexelsRgba32ui => vk::DescriptorType::STORAGE_TEXEL_BUFFER,
        _ => vk::DescriptorType::STORAGE_IMAGE,
    }
}
