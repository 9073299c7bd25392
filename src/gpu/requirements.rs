//! What rendering needs of a Vulkan device, as data: for choosing a device, for creating one, and
//! for hosts that create their own.
//!
//! No extension is needed beside Vulkan 1.3. Required features are those without which nothing
//! runs; optional ones make it faster. Two limits must be above the least that Vulkan allows.

use ash::vk::{self, StructureType as Type};

/// The feature structures that rendering uses.
#[derive(Clone, Copy, Default)]
pub struct Features {
    pub v10: vk::PhysicalDeviceFeatures,
    pub v12: vk::PhysicalDeviceVulkan12Features<'static>,
    pub v13: vk::PhysicalDeviceVulkan13Features<'static>,
}

/// A feature that rendering uses.
pub struct Feature {
    /// Name of the member in Vulkan's structures.
    pub name: &'static str,
    /// Vulkan's structure that has the member.
    pub structure: &'static str,
    /// The feature's own structure, with the member first; a chain has either that or `structure`.
    /// Features of Vulkan 1.0 have none.
    pub own: Option<vk::StructureType>,
    pub required: bool,
    /// What it is needed for.
    pub purpose: &'static str,
    field: fn(&mut Features) -> &mut vk::Bool32,
}

macro_rules! features {
    ($($required:literal $structure:literal $own:expr,
        $part:ident.$field:ident $name:literal: $purpose:literal),* $(,)?) => {
        &[$(Feature {
            name: $name,
            structure: $structure,
            own: $own,
            required: $required,
            purpose: $purpose,
            field: |features| &mut features.$part.$field,
        }),*]
    };
}

/// The features, required ones first.
pub const FEATURES: &[Feature] = features![
    true "VkPhysicalDeviceFeatures" None,
        v10.fragment_stores_and_atomics "fragmentStoresAndAtomics":
        "strokes count fragments while they are drawn",
    true "VkPhysicalDeviceVulkan12Features"
        Some(Type::PHYSICAL_DEVICE_TIMELINE_SEMAPHORE_FEATURES),
        v12.timeline_semaphore "timelineSemaphore":
        "the loader tells which nodes it has written",
    true "VkPhysicalDeviceVulkan12Features"
        Some(Type::PHYSICAL_DEVICE_BUFFER_DEVICE_ADDRESS_FEATURES),
        v12.buffer_device_address "bufferDeviceAddress":
        "kernels read pages of points by address",
    true "VkPhysicalDeviceVulkan12Features"
        Some(Type::PHYSICAL_DEVICE_SCALAR_BLOCK_LAYOUT_FEATURES),
        v12.scalar_block_layout "scalarBlockLayout":
        "structures have the same layout in Rust and GLSL",
    true "VkPhysicalDeviceVulkan13Features"
        Some(Type::PHYSICAL_DEVICE_SYNCHRONIZATION_2_FEATURES),
        v13.synchronization2 "synchronization2":
        "barriers",
    true "VkPhysicalDeviceVulkan13Features"
        Some(Type::PHYSICAL_DEVICE_DYNAMIC_RENDERING_FEATURES),
        v13.dynamic_rendering "dynamicRendering":
        "draws have no render passes",
    true "VkPhysicalDeviceVulkan13Features"
        Some(Type::PHYSICAL_DEVICE_MAINTENANCE_4_FEATURES),
        v13.maintenance4 "maintenance4":
        "memory is planned before images exist",
    true "VkPhysicalDeviceVulkan13Features"
        Some(Type::PHYSICAL_DEVICE_IMAGE_ROBUSTNESS_FEATURES),
        v13.robust_image_access "robustImageAccess":
        "kernels read beyond the edges of pictures",
    true "VkPhysicalDeviceVulkan13Features"
        Some(Type::PHYSICAL_DEVICE_SHADER_DEMOTE_TO_HELPER_INVOCATION_FEATURES),
        v13.shader_demote_to_helper_invocation "shaderDemoteToHelperInvocation":
        "fragment shaders discard",
    false "VkPhysicalDeviceFeatures" None,
        v10.shader_int64 "shaderInt64":
        "points are drawn in one walk instead of two, with shaderBufferInt64Atomics",
    false "VkPhysicalDeviceVulkan12Features"
        Some(Type::PHYSICAL_DEVICE_SHADER_ATOMIC_INT64_FEATURES),
        v12.shader_buffer_int64_atomics "shaderBufferInt64Atomics":
        "points are drawn in one walk instead of two, with shaderInt64",
];

/// Returns the features of a device; it must have Vulkan 1.3.
fn available(instance: &ash::Instance, device: vk::PhysicalDevice) -> Features {
    let mut found = Features::default();
    let mut all =
        vk::PhysicalDeviceFeatures2::default().push_next(&mut found.v12).push_next(&mut found.v13);
    // SAFETY: the device has Vulkan 1.3, so it knows these structures.
    unsafe { instance.get_physical_device_features2(device, &mut all) };
    found.v10 = all.features;
    found
}

/// A limit that must be above the least value that Vulkan allows.
struct Limit {
    /// Name of the member in `VkPhysicalDeviceLimits`.
    name: &'static str,
    least: u32,
    value: fn(&vk::PhysicalDeviceLimits) -> u32,
}

/// What the shader binds that binds most, from `build.rs`.
mod most {
    include!(concat!(env!("OUT_DIR"), "/most.rs"));
}

const LIMITS: [Limit; 2] = [
    Limit {
        name: "maxPerStageDescriptorStorageBuffers",
        least: most::STORAGE_BUFFERS,
        value: |limits| limits.max_per_stage_descriptor_storage_buffers,
    },
    Limit {
        name: "maxPerStageDescriptorStorageImages",
        least: most::STORAGE_IMAGES,
        value: |limits| limits.max_per_stage_descriptor_storage_images,
    },
];

/// Returns the names of what is required and missing.
pub fn check(instance: &ash::Instance, device: vk::PhysicalDevice) -> Vec<String> {
    // SAFETY: plain query of a live instance.
    let properties = unsafe { instance.get_physical_device_properties(device) };
    if properties.api_version < vk::API_VERSION_1_3 {
        return vec!["Vulkan 1.3".into()];
    }
    let low = LIMITS.iter().filter_map(|Limit { name, least, value }| {
        let value = value(&properties.limits);
        (value < *least).then(|| format!("{name} of {least} (it has {value})"))
    });
    let mut found = available(instance, device);
    let is_missing = |feature: &&Feature| *(feature.field)(&mut found) == vk::FALSE;
    let required = FEATURES.iter().filter(|feature| feature.required);
    required.filter(is_missing).map(|feature| feature.name.into()).chain(low).collect()
}

/// Returns whether a device has all optional features; it must have Vulkan 1.3.
pub fn has_optional(instance: &ash::Instance, device: vk::PhysicalDevice) -> bool {
    let mut found = available(instance, device);
    let mut optional = FEATURES.iter().filter(|feature| !feature.required);
    optional.all(|feature| *(feature.field)(&mut found) == vk::TRUE)
}

/// Returns the features to enable: those that are required, and the optional ones if wanted.
pub fn wanted(optional: bool) -> impl Iterator<Item = &'static Feature> {
    FEATURES.iter().filter(move |feature| feature.required || optional)
}

impl Feature {
    /// Enables it.
    pub fn enable(&self, features: &mut Features) {
        *(self.field)(features) = vk::TRUE;
    }
}
