//! The host's Vulkan objects, as raw handles: no version of a Vulkan crate is shared.
//!
//! A handle is the number that `ash::vk::Handle::as_raw` returns, or the C handle itself.

use crate::error::{Error, Result};
use crate::gpu;
use crate::gpu::requirements::{FEATURES, Features};
use ash::vk::{self, Handle};
use std::ffi::c_void;

/// The host's instance and device. Its queue is not needed: nothing is submitted here.
#[derive(Clone, Copy, Debug)]
pub struct Host {
    /// Address of `vkGetInstanceProcAddr`.
    pub get_instance_proc_addr: *const c_void,
    /// `VkInstance`, of Vulkan 1.3 or newer.
    pub instance: u64,
    /// `VkPhysicalDevice`.
    pub physical_device: u64,
    /// `VkDevice`, with what [`requirements`] lists as required.
    pub device: u64,
    /// Queue family of the command buffers, with graphics and compute.
    pub queue_family: u32,
    /// True if `shaderInt64` and `shaderBufferInt64Atomics` are enabled.
    pub has_int64_atomics: bool,
    /// True if the instance has `VK_EXT_debug_utils`; objects and passes then have names.
    pub has_debug_utils: bool,
    /// Address of `VkAllocationCallbacks` for the CPU memory of all objects that are made here, on
    /// any thread; null if there are none. They are copied. Device memory is allocated without
    /// them.
    pub allocation_callbacks: *const c_void,
    /// Addresses of functions that are called, on any thread, in place of
    /// `vkAllocateMemory` and `vkFreeMemory`; both null if there are none. They are called for
    /// blocks of many buffers and images, and may refuse with `VK_ERROR_OUT_OF_DEVICE_MEMORY`.
    pub allocate_memory: *const c_void,
    /// The other of the two.
    pub free_memory: *const c_void,
}

/// A device feature that rendering needs, or uses if it is enabled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Requirement {
    /// Name of the member, such as `synchronization2`.
    pub feature: &'static str,
    /// Vulkan structure that has the member.
    pub structure: &'static str,
    /// True if nothing works without it.
    pub required: bool,
    /// What it is for.
    pub purpose: &'static str,
}

/// Returns the features that a device must have, and those that make it faster. No extension is
/// needed beside Vulkan 1.3.
pub fn requirements() -> Vec<Requirement> {
    let requirement = |feature: &gpu::requirements::Feature| Requirement {
        feature: feature.name,
        structure: feature.structure,
        required: feature.required,
        purpose: feature.purpose,
    };
    FEATURES.iter().map(requirement).collect()
}

/// Checks a physical device before the host creates its device. Errors name what is missing.
///
/// # Safety
/// The handles and the address are valid.
pub unsafe fn check(
    get_instance_proc_addr: *const c_void,
    instance: u64,
    physical_device: u64,
) -> Result<()> {
    // SAFETY: as the caller ensures.
    let instance = unsafe {
        let function = entry_point(get_instance_proc_addr)?;
        let entry = ash::Entry::from_static_fn(ash::StaticFn { get_instance_proc_addr: function });
        ash::Instance::load(entry.static_fn(), vk::Instance::from_raw(instance))
    };
    let physical_device = vk::PhysicalDevice::from_raw(physical_device);
    let missing = gpu::requirements::check(&instance, physical_device);
    if missing.is_empty() {
        return Ok(());
    }
    Err(Error::Device(format!("the device lacks {}", missing.join(", "))))
}

/// Enables the required features in the host's `VkPhysicalDeviceFeatures2` and the structures that
/// follow it, and the optional ones if `optional`; what is enabled already stays. A feature of
/// Vulkan 1.2 or 1.3 is enabled in `VkPhysicalDeviceVulkan12Features` or
/// `VkPhysicalDeviceVulkan13Features`, or in a structure of its own. Errors if the chain has
/// neither.
///
/// # Safety
/// `chain` is a `VkPhysicalDeviceFeatures2`, and what follows are valid Vulkan structures.
pub unsafe fn enable_features(chain: *mut c_void, optional: bool) -> Result<()> {
    use vk::StructureType as Type;
    let (mut v10, mut v12, mut v13, mut own) = (None, None, None, Vec::new());
    let mut next = chain.cast::<vk::BaseOutStructure>();
    while !next.is_null() {
        // SAFETY: every structure of a chain begins with its type and the next one.
        unsafe {
            match (*next).s_type {
                Type::PHYSICAL_DEVICE_FEATURES_2 => {
                    v10 = Some(&mut *next.cast::<vk::PhysicalDeviceFeatures2>());
                }
                Type::PHYSICAL_DEVICE_VULKAN_1_2_FEATURES => {
                    v12 = Some(&mut *next.cast::<vk::PhysicalDeviceVulkan12Features>());
                }
                Type::PHYSICAL_DEVICE_VULKAN_1_3_FEATURES => {
                    v13 = Some(&mut *next.cast::<vk::PhysicalDeviceVulkan13Features>());
                }
                kind => own.push((kind, next)),
            }
            next = (*next).p_next;
        }
    }
    let mut features = Features {
        v10: v10.as_ref().map_or_else(Default::default, |found| found.features),
        v12: v12.as_ref().map_or_else(Default::default, |found| **found),
        v13: v13.as_ref().map_or_else(Default::default, |found| **found),
    };
    let mut places = Vec::new();
    for feature in gpu::requirements::wanted(optional) {
        let is_there = match feature.structure {
            "VkPhysicalDeviceVulkan12Features" => v12.is_some(),
            "VkPhysicalDeviceVulkan13Features" => v13.is_some(),
            _ => v10.is_some(),
        };
        match own.iter().find(|(kind, _)| Some(*kind) == feature.own) {
            _ if is_there => feature.enable(&mut features),
            // The member follows the type and the next structure.
            // SAFETY: the structure has this type, so it is longer than its beginning.
            Some((_, place)) => places.push(unsafe { place.add(1).cast::<vk::Bool32>() }),
            None => {
                let own = feature.own.map_or(String::new(), |own| {
                    format!(", and none of the type {own:?}; add one of them")
                });
                let (name, structure) = (feature.name, feature.structure);
                return Err(Error::Request(format!(
                    "{name} cannot be enabled: the chain has no {structure}{own}"
                )));
            }
        }
    }
    // From here on nothing fails: a chain that is refused is as it was.
    // SAFETY: as above.
    places.into_iter().for_each(|place| unsafe { *place = vk::TRUE });
    v10.into_iter().for_each(|found| found.features = features.v10);
    v12.into_iter().for_each(|found| *found = features.v12);
    v13.into_iter().for_each(|found| *found = features.v13);
    Ok(())
}

/// # Safety
/// The address is null or that of `vkGetInstanceProcAddr`.
unsafe fn entry_point(address: *const c_void) -> Result<vk::PFN_vkGetInstanceProcAddr> {
    if address.is_null() {
        return Err(Error::Request("get_instance_proc_addr is null".into()));
    }
    // SAFETY: as the caller ensures.
    Ok(unsafe { std::mem::transmute::<*const c_void, vk::PFN_vkGetInstanceProcAddr>(address) })
}

impl Host {
    /// # Safety
    /// The addresses are null, or those of functions of their types.
    unsafe fn memory_functions(&self) -> Result<Option<gpu::MemoryFunctions>> {
        match (self.allocate_memory.is_null(), self.free_memory.is_null()) {
            (true, true) => Ok(None),
            // SAFETY: as the caller ensures; a function's address is as wide as a pointer.
            (false, false) => Ok(Some(unsafe {
                gpu::MemoryFunctions {
                    allocate: std::mem::transmute::<*const c_void, vk::PFN_vkAllocateMemory>(
                        self.allocate_memory,
                    ),
                    free: std::mem::transmute::<*const c_void, vk::PFN_vkFreeMemory>(
                        self.free_memory,
                    ),
                }
            })),
            _ => Err(Error::Request("one of allocate_memory and free_memory is null".into())),
        }
    }

    /// # Safety
    /// The addresses are null, or those of `vkGetInstanceProcAddr` and of callbacks.
    pub(super) unsafe fn device(&self, overrides: gpu::TestOverrides) -> Result<gpu::HostDevice> {
        if self.instance == 0 || self.physical_device == 0 || self.device == 0 {
            return Err(Error::Request("a handle of the host is null".into()));
        }
        Ok(gpu::HostDevice {
            // SAFETY: as the caller ensures.
            get_instance_proc_addr: unsafe { entry_point(self.get_instance_proc_addr) }?,
            instance: vk::Instance::from_raw(self.instance),
            physical_device: vk::PhysicalDevice::from_raw(self.physical_device),
            device: vk::Device::from_raw(self.device),
            queue_family: self.queue_family,
            has_int64_atomics: self.has_int64_atomics,
            has_debug_utils: self.has_debug_utils,
            // SAFETY: null or valid, as the caller ensures.
            allocation_callbacks: unsafe {
                self.allocation_callbacks.cast::<vk::AllocationCallbacks>().as_ref().copied()
            },
            // SAFETY: null or valid, as the caller ensures.
            device_memory: unsafe { self.memory_functions() }?,
            overrides,
        })
    }
}

/// How an image was used, or will be.
///
/// With a transfer of ownership between queue families, the host records the other half of each
/// barrier: before the frame a release from the layout of `before` to `COLOR_ATTACHMENT_OPTIMAL`
/// (of depth: `DEPTH_STENCIL_ATTACHMENT_OPTIMAL`), after it an acquisition from there to the layout
/// of `after`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Access {
    /// `VkImageLayout`.
    pub layout: i32,
    /// `VkPipelineStageFlags2`.
    pub stages: u64,
    /// `VkAccessFlags2`.
    pub access: u64,
    /// Queue family that owns the image; [`Access::SAME_FAMILY`] if it is the renderer's.
    pub family: u32,
}

impl Access {
    /// The family of the command buffers: no transfer of ownership.
    pub const SAME_FAMILY: u32 = vk::QUEUE_FAMILY_IGNORED;

    /// Returns an access in a layout by any stage of the same family, which is always correct.
    pub fn any(layout: i32) -> Access {
        Access {
            layout,
            stages: vk::PipelineStageFlags2::ALL_COMMANDS.as_raw(),
            access: (vk::AccessFlags2::MEMORY_READ | vk::AccessFlags2::MEMORY_WRITE).as_raw(),
            family: Access::SAME_FAMILY,
        }
    }
}

/// An image of the host to draw into: one layer, one level, one sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Target {
    /// `VkImage`, with usage as colour or depth attachment.
    pub image: u64,
    /// `VkImageView` of it.
    pub view: u64,
    /// `VkFormat`.
    pub format: i32,
    /// Width and height `[px]`.
    pub size: [u32; 2],
    /// Samples per pixel; only 1 is drawn into.
    pub samples: u32,
    /// Last access before.
    pub before: Access,
    /// First access afterwards.
    pub after: Access,
    /// True if the area is cleared first: colour to the background, depth to what is farthest.
    pub clear: bool,
}

/// Values that colours are stored as.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Encoding {
    /// Encoded for display: what a file has. The device encodes if the format is sRGB.
    #[default]
    Srgb,
    /// Linear.
    Linear,
}

impl Target {
    pub(super) fn vulkan_format(&self) -> vk::Format {
        vk::Format::from_raw(self.format)
    }

    fn aspects(&self) -> vk::ImageAspectFlags {
        use vk::ImageAspectFlags as Aspect;
        match self.vulkan_format() {
            vk::Format::D16_UNORM | vk::Format::X8_D24_UNORM_PACK32 | vk::Format::D32_SFLOAT => {
                Aspect::DEPTH
            }
            vk::Format::D16_UNORM_S8_UINT
            | vk::Format::D24_UNORM_S8_UINT
            | vk::Format::D32_SFLOAT_S8_UINT => Aspect::DEPTH | Aspect::STENCIL,
            _ => Aspect::COLOR,
        }
    }

    /// Returns the bits of its depths.
    pub(super) fn depth_bits(&self) -> u32 {
        use vk::Format as F;
        match self.vulkan_format() {
            F::D16_UNORM | F::D16_UNORM_S8_UINT => 16,
            F::X8_D24_UNORM_PACK32 | F::D24_UNORM_S8_UINT => 24,
            _ => 32,
        }
    }

    /// Errors if nothing can be drawn into it.
    pub(super) fn check(&self, name: &str, is_depth: bool) -> Result<()> {
        let wrong = |what: String| Err(Error::Request(format!("the {name} target {what}")));
        if self.image == 0 || self.view == 0 {
            return wrong("has a null handle".into());
        }
        if self.samples != 1 {
            return wrong(format!(
                "has {} samples per pixel; resolve it first, or give an image with one",
                self.samples
            ));
        }
        if (self.aspects() != vk::ImageAspectFlags::COLOR) != is_depth {
            let format = self.vulkan_format();
            return wrong(format!("has the format {format:?}, which is not one of {name}"));
        }
        Ok(())
    }

    /// Returns the barrier from the access before to `layout`, or from there to the access after.
    pub(super) fn barrier(
        &self,
        family: u32,
        layout: vk::ImageLayout,
        ends: bool,
    ) -> vk::ImageMemoryBarrier2<'static> {
        let own = Access { layout: layout.as_raw(), ..Access::any(0) };
        let (from, to) = if ends { (own, self.after) } else { (self.before, own) };
        // A transfer of ownership names both families.
        let theirs = if ends { to.family } else { from.family };
        let transfers = theirs != Access::SAME_FAMILY && theirs != family;
        let families = match (transfers, ends) {
            (false, _) => [Access::SAME_FAMILY; 2],
            (true, false) => [theirs, family],
            (true, true) => [family, theirs],
        };
        vk::ImageMemoryBarrier2::default()
            .src_stage_mask(vk::PipelineStageFlags2::from_raw(from.stages))
            .src_access_mask(vk::AccessFlags2::from_raw(from.access))
            .dst_stage_mask(vk::PipelineStageFlags2::from_raw(to.stages))
            .dst_access_mask(vk::AccessFlags2::from_raw(to.access))
            .old_layout(vk::ImageLayout::from_raw(from.layout))
            .new_layout(vk::ImageLayout::from_raw(to.layout))
            .src_queue_family_index(families[0])
            .dst_queue_family_index(families[1])
            .image(vk::Image::from_raw(self.image))
            .subresource_range(vk::ImageSubresourceRange {
                aspect_mask: self.aspects(),
                level_count: 1,
                layer_count: 1,
                ..Default::default()
            })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Enables what is required in a chain that begins with `first`.
    fn enabled(first: &mut vk::PhysicalDeviceFeatures2, optional: bool) -> Result<()> {
        // SAFETY: the chains below are valid.
        unsafe { enable_features((&raw mut *first).cast(), optional) }
    }

    #[test]
    fn features_are_enabled_where_the_chain_has_them() {
        let mut v13 = vk::PhysicalDeviceVulkan13Features::default();
        let mut timeline = vk::PhysicalDeviceTimelineSemaphoreFeatures::default();
        let mut addresses = vk::PhysicalDeviceBufferDeviceAddressFeatures::default();
        let mut scalars = vk::PhysicalDeviceScalarBlockLayoutFeatures::default();
        let mut first = vk::PhysicalDeviceFeatures2::default()
            .push_next(&mut timeline)
            .push_next(&mut addresses)
            .push_next(&mut scalars)
            .push_next(&mut v13);
        enabled(&mut first, false).unwrap();
        assert_eq!(first.features.fragment_stores_and_atomics, vk::TRUE);
        assert_eq!(first.features.shader_int64, vk::FALSE);
        let own = [
            timeline.timeline_semaphore,
            addresses.buffer_device_address,
            scalars.scalar_block_layout,
            v13.synchronization2,
            v13.maintenance4,
        ];
        assert_eq!(own, [vk::TRUE; 5]);
        assert_eq!(addresses.buffer_device_address_capture_replay, vk::FALSE);
    }

    #[test]
    fn a_chain_without_a_place_is_refused_and_as_it_was() {
        let mut v12 = vk::PhysicalDeviceVulkan12Features::default();
        let mut rendering = vk::PhysicalDeviceDynamicRenderingFeatures::default();
        let mut first =
            vk::PhysicalDeviceFeatures2::default().push_next(&mut v12).push_next(&mut rendering);
        let refused = enabled(&mut first, true).unwrap_err().to_string();
        assert_eq!(
            refused,
            "synchronization2 cannot be enabled: the chain has no VkPhysicalDeviceVulkan13Features, and none of the type PHYSICAL_DEVICE_SYNCHRONIZATION_2_FEATURES; add one of them"
        );
        assert_eq!(first.features.fragment_stores_and_atomics, vk::FALSE);
        assert_eq!((v12.timeline_semaphore, rendering.dynamic_rendering), (vk::FALSE, vk::FALSE));
    }
}
