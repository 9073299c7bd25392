//! Finds and opens a Vulkan device.
//!
//! Of the devices with all required features the best kind wins: discrete, integrated, virtual,
//! CPU. An error names the missing features. Validation enables core and synchronization checks;
//! their messages are collected and turned into errors of the submission that caused them.

use super::requirements::{self, Features};
use super::{LogicalDevice, drivers, failed};
use crate::error::{Error, Result};
use ash::{ext, khr, vk};
use std::ffi::{CStr, c_char, c_void};
use std::sync::Mutex;

/// Options of `--device` and `--validate`.
#[derive(Clone, Debug, Default)]
pub struct DeviceOptions {
    /// Part of the device's name (case-insensitive), or its index in the loader's order.
    pub device: Option<String>,
    /// Has Khronos' validation layers check each call.
    pub validate: bool,
    /// Enables window surfaces and swapchains.
    pub window: bool,
    /// What tests pretend.
    #[doc(hidden)]
    pub overrides: TestOverrides,
}

/// What tests pretend about a device.
#[derive(Clone, Copy, Debug, Default)]
pub struct TestOverrides {
    /// There are no 64-bit atomics: forces the two-pass path.
    pub no_int64_atomics: bool,
    /// Texel buffers are small: forces word loads.
    pub no_texels: bool,
    /// The CPU cannot map most device memory: forces the staging ring.
    pub unmapped: bool,
    /// The device is lost after this many submissions.
    pub lost_after: Option<u64>,
    /// The window surface is lost after this many presentations, until it is recreated.
    pub surface_lost_after: Option<u64>,
}

/// A device with one queue for compute and graphics, or a host's device without a queue.
pub struct Device {
    /// Keeps the Vulkan library loaded.
    pub entry: ash::Entry,
    pub instance: ash::Instance,
    pub physical: vk::PhysicalDevice,
    pub raw: LogicalDevice,
    /// `None` for a host's device: nothing is submitted to it, and it is not destroyed here.
    pub queue: Option<vk::Queue>,
    pub family: u32,
    pub limits: vk::PhysicalDeviceLimits,
    pub name: String,
    pub driver: String,
    /// True if it is a software device (lavapipe, SwiftShader); kernels choose other loop shapes
    /// there.
    pub is_cpu: bool,
    /// True if there are 64-bit integers and buffer atomics on them.
    pub int64_atomics: bool,
    /// True if the CPU can map all device-local memory. A graphics card without a resizable BAR
    /// maps only 256 MiB.
    pub has_host_visible_vram: bool,
    /// True if the queue family has timestamps.
    pub has_timestamps: bool,
    /// True if texel buffers hold pages, keys and tile lists; Vulkan guarantees only 65,536 texels.
    pub has_large_texel_buffers: bool,
    /// Most workgroups of a pass over a list whose entries may need no work. Few on a CPU, where
    /// each workgroup runs through its code even if there is nothing to do.
    pub max_workgroups: u32,
    /// Largest allocation `[bytes]`.
    pub max_allocation: u64,
    pub labels: Option<ext::debug_utils::Device>,
    messenger: Option<(ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT)>,
    // Boxed, because the messenger holds its address.
    messages: Box<Mutex<Vec<String>>>,
}

/// Vulkan objects of a host, and the optional features that it has enabled.
pub struct HostDevice {
    pub get_instance_proc_addr: vk::PFN_vkGetInstanceProcAddr,
    pub instance: vk::Instance,
    pub physical_device: vk::PhysicalDevice,
    pub device: vk::Device,
    pub queue_family: u32,
    pub has_int64_atomics: bool,
    pub has_debug_utils: bool,
    pub allocation_callbacks: Option<vk::AllocationCallbacks<'static>>,
    pub device_memory: Option<MemoryFunctions>,
    pub overrides: TestOverrides,
}

/// A host's functions in place of those that allocate and free device memory.
#[derive(Clone, Copy)]
pub struct MemoryFunctions {
    pub allocate: vk::PFN_vkAllocateMemory,
    pub free: vk::PFN_vkFreeMemory,
}

/// Texels of 32 bits in the largest storage buffer that Vulkan devices commonly bind (128 MiB).
const MIN_TEXELS: u32 = 1 << 25;

const WINDOW_SYSTEMS: [&CStr; 6] = [
    khr::surface::NAME,
    khr::wayland_surface::NAME,
    khr::xcb_surface::NAME,
    khr::xlib_surface::NAME,
    khr::win32_surface::NAME,
    ext::metal_surface::NAME,
];

const VALIDATION_LAYER: &CStr = c"VK_LAYER_KHRONOS_validation";

impl Device {
    pub fn open(options: &DeviceOptions) -> Result<Device> {
        // SAFETY: loading the system's Vulkan loader runs its initialisers, as in every Vulkan
        // program.
        let entry = unsafe { ash::Entry::load() }.map_err(|error| {
            let advice = drivers::advice_without_loader();
            Error::Device(format!("no Vulkan loader ({error}); {advice}"))
        })?;
        let messages = Box::new(Mutex::new(Vec::new()));
        let (instance, debug) = open_instance(&entry, options)?;
        let mut messenger = None;
        let opened = (|| {
            if let Some(debug) = debug.as_ref().filter(|_| options.validate) {
                messenger = Some(create_debug_messenger(debug, &messages)?);
            }
            let (physical, missing_int64) = choose(&instance, options)?;
            let int64_atomics = !missing_int64 && !options.overrides.no_int64_atomics;
            let family = queue_family(&instance, physical).ok_or_else(|| {
                Error::Device("the device has no queue for compute and graphics".to_string())
            })?;
            let raw = open_device(&instance, physical, family, int64_atomics, options.window)?;
            Ok((physical, family, int64_atomics, raw))
        })();
        let (physical, family, int64_atomics, raw) = opened.inspect_err(|_| {
            // SAFETY: both were made above and are used nowhere else; nothing else made from the
            // instance is left.
            unsafe {
                if let (Some(debug), Some(messenger)) = (&debug, messenger) {
                    debug.destroy_debug_utils_messenger(messenger, None);
                }
                instance.destroy_instance(None);
            }
        })?;
        let raw = LogicalDevice::new(raw, None);
        // SAFETY: `open_device` requested this family and its queue 0.
        let queue = unsafe { raw.get_device_queue(family, 0) };
        let labels = debug.as_ref().map(|_| ext::debug_utils::Device::new(&instance, &raw));
        let mut device = Device::around(entry, instance, physical, raw, family);
        device.queue = Some(queue);
        device.int64_atomics = int64_atomics;
        device.has_host_visible_vram &= !options.overrides.unmapped;
        device.has_large_texel_buffers &= !options.overrides.no_texels;
        (device.labels, device.messenger, device.messages) =
            (labels, debug.zip(messenger), messages);
        Ok(device)
    }

    /// Uses a device of a host.
    ///
    /// # Safety
    /// The handles are valid until the result is dropped, the device belongs to the instance and
    /// has the family, and all that [`requirements`] lists as required is enabled.
    pub unsafe fn adopt(host: &HostDevice) -> Result<Device> {
        // SAFETY: as the caller ensures.
        let (entry, instance, raw) = unsafe {
            let entry = ash::Entry::from_static_fn(ash::StaticFn {
                get_instance_proc_addr: host.get_instance_proc_addr,
            });
            let instance = ash::Instance::load(entry.static_fn(), host.instance);
            let load = instance.fp_v1_0().get_device_proc_addr;
            let raw = ash::Device::load_with(
                |name| match (name.to_bytes(), host.device_memory) {
                    (b"vkAllocateMemory", Some(functions)) => functions.allocate as *const c_void,
                    (b"vkFreeMemory", Some(functions)) => functions.free as *const c_void,
                    _ => load(host.device, name.as_ptr())
                        .map_or(std::ptr::null(), |found| found as *const c_void),
                },
                host.device,
            );
            let raw = LogicalDevice::new(raw, host.allocation_callbacks);
            (entry, instance, raw)
        };
        let physical = host.physical_device;
        if let missing @ [_, ..] = &requirements::check(&instance, physical)[..] {
            return Err(Error::Device(format!("the device lacks {}", missing.join(", "))));
        }
        // SAFETY: a plain query of a live instance.
        let families = unsafe { instance.get_physical_device_queue_family_properties(physical) };
        let needed = vk::QueueFlags::GRAPHICS | vk::QueueFlags::COMPUTE;
        match families.get(host.queue_family as usize) {
            Some(family) if family.queue_flags.contains(needed) => {}
            _ => {
                return Err(Error::Request(format!(
                    "queue family {} of {} does not exist, or has no graphics and compute",
                    host.queue_family,
                    families.len()
                )));
            }
        }
        let mut device = Device::around(entry, instance, physical, raw, host.queue_family);
        device.has_host_visible_vram &= !host.overrides.unmapped;
        device.int64_atomics = host.has_int64_atomics;
        device.labels = host
            .has_debug_utils
            .then(|| ext::debug_utils::Device::new(&device.instance, &device.raw));
        Ok(device)
    }

    /// Describes a device, without a queue and without optional features.
    fn around(
        entry: ash::Entry,
        instance: ash::Instance,
        physical: vk::PhysicalDevice,
        raw: LogicalDevice,
        family: u32,
    ) -> Device {
        // SAFETY: plain queries of a live instance.
        let (properties, memory, families) = unsafe {
            (
                instance.get_physical_device_properties(physical),
                instance.get_physical_device_memory_properties(physical),
                instance.get_physical_device_queue_family_properties(physical),
            )
        };
        let (driver, max_allocation) = driver(&instance, physical);
        Device {
            physical,
            raw,
            queue: None,
            family,
            limits: properties.limits,
            name: text(&properties.device_name),
            driver,
            is_cpu: properties.device_type == vk::PhysicalDeviceType::CPU,
            int64_atomics: false,
            has_host_visible_vram: has_host_visible_vram(&memory),
            has_timestamps: families[family as usize].timestamp_valid_bits > 0,
            has_large_texel_buffers: properties.limits.max_texel_buffer_elements >= MIN_TEXELS,
            max_workgroups: match properties.device_type {
                vk::PhysicalDeviceType::CPU => {
                    8 * std::thread::available_parallelism().map_or(1, |cores| cores.get() as u32)
                }
                _ => properties.limits.max_compute_work_group_count[0],
            },
            max_allocation,
            labels: None,
            messenger: None,
            messages: Box::default(),
            instance,
            entry,
        }
    }

    /// Returns the queue of a device of our own.
    pub fn own_queue(&self) -> vk::Queue {
        self.queue.expect("nothing is submitted to a host's device")
    }

    /// Returns the messages of the validation layers since the last call as an error, if there are
    /// any.
    pub fn take_validation_errors(&self) -> Result<()> {
        let said = std::mem::take(
            &mut *self.messages.lock().unwrap_or_else(|poisoned| poisoned.into_inner()),
        );
        if said.is_empty() { Ok(()) } else { Err(Error::Validation(said.join("\n"))) }
    }

    /// Names an object for captures and validation messages.
    pub fn name<H: vk::Handle>(&self, handle: H, name: &str) {
        if let Some(labels) = &self.labels {
            let name = std::ffi::CString::new(name).unwrap_or_default();
            let info =
                vk::DebugUtilsObjectNameInfoEXT::default().object_handle(handle).object_name(&name);
            // SAFETY: the handle belongs to this device. A lost name only makes messages less
            // clear.
            let _ = unsafe { labels.set_debug_utils_object_name(&info) };
        }
    }
}

/// Returns whether a host-visible memory type lies in a heap as large as the largest device-local
/// one.
fn has_host_visible_vram(memory: &vk::PhysicalDeviceMemoryProperties) -> bool {
    use vk::MemoryPropertyFlags as Flags;
    let largest = |wanted: Flags| {
        let types = memory
            .memory_types_as_slice()
            .iter()
            .filter(|kind| kind.property_flags.contains(wanted));
        types.map(|kind| memory.memory_heaps[kind.heap_index as usize].size).max().unwrap_or(0)
    };
    largest(Flags::DEVICE_LOCAL | Flags::HOST_VISIBLE | Flags::HOST_COHERENT)
        >= largest(Flags::DEVICE_LOCAL)
}

impl Drop for Device {
    fn drop(&mut self) {
        if self.queue.is_none() {
            return;
        }
        // SAFETY: all objects of the device borrow or own it and are gone by now; the device is
        // idle because every submission has been waited for.
        unsafe {
            self.raw.destroy_device(None);
            // Reports objects that outlived the device; an error cannot be returned here.
            if let Err(error) = self.take_validation_errors() {
                log::error!("{error}");
            }
            if let Some((debug, messenger)) = self.messenger.take() {
                debug.destroy_debug_utils_messenger(messenger, None);
            }
            self.instance.destroy_instance(None);
        }
    }
}

/// Lists index, name and type of each device, for error messages.
fn list(instance: &ash::Instance, devices: &[vk::PhysicalDevice]) -> String {
    let line = |(index, &device)| {
        // SAFETY: the device comes from this instance.
        let properties = unsafe { instance.get_physical_device_properties(device) };
        format!("{index}: {} ({:?})", text(&properties.device_name), properties.device_type)
    };
    devices.iter().enumerate().map(line).collect::<Vec<_>>().join("; ")
}

fn open_instance(
    entry: &ash::Entry,
    options: &DeviceOptions,
) -> Result<(ash::Instance, Option<ext::debug_utils::Instance>)> {
    let app = vk::ApplicationInfo::default()
        .application_name(c"pointillist")
        .api_version(vk::API_VERSION_1_3);
    let validate = options.validate;
    // SAFETY: plain queries of the loader.
    let (layers, extensions) = unsafe {
        (
            entry.enumerate_instance_layer_properties().unwrap_or_default(),
            entry.enumerate_instance_extension_properties(None).unwrap_or_default(),
        )
    };
    if validate && !layers.iter().any(|layer| layer.layer_name_as_c_str() == Ok(VALIDATION_LAYER)) {
        return Err(Error::Device(
            "--validate needs the Vulkan validation layers; install vulkan-validationlayers"
                .to_string(),
        ));
    }
    // The validation layer provides debug_utils even if the loader does not list it.
    let offers = |name: &CStr| {
        extensions.iter().any(|extension| extension.extension_name_as_c_str() == Ok(name))
    };
    let has_debug = validate || offers(ext::debug_utils::NAME);
    let layer_names: Vec<*const c_char> =
        if validate { vec![VALIDATION_LAYER.as_ptr()] } else { vec![] };
    let mut extension_names: Vec<*const c_char> =
        if has_debug { vec![ext::debug_utils::NAME.as_ptr()] } else { vec![] };
    // Devices on top of another interface, such as Metal, are listed to those who ask for them.
    let has_portability = offers(khr::portability_enumeration::NAME);
    extension_names.extend(has_portability.then_some(khr::portability_enumeration::NAME.as_ptr()));
    if options.window {
        if !offers(khr::surface::NAME) {
            return Err(Error::Device("the Vulkan loader supports no window system".to_string()));
        }
        // The window system in use is known only when the window exists.
        extension_names
            .extend(WINDOW_SYSTEMS.iter().filter(|name| offers(name)).map(|name| name.as_ptr()));
    }
    let checks = [vk::ValidationFeatureEnableEXT::SYNCHRONIZATION_VALIDATION];
    let mut features = vk::ValidationFeaturesEXT::default().enabled_validation_features(&checks);
    let mut info = vk::InstanceCreateInfo::default()
        .application_info(&app)
        .enabled_layer_names(&layer_names)
        .enabled_extension_names(&extension_names);
    if has_portability {
        info = info.flags(vk::InstanceCreateFlags::ENUMERATE_PORTABILITY_KHR);
    }
    if validate {
        info = info.push_next(&mut features);
    }
    // SAFETY: every pointer in `info` outlives the call.
    let instance = unsafe { entry.create_instance(&info, None) }.map_err(|code| match code {
        // The loader's answer if it has no driver.
        vk::Result::ERROR_INCOMPATIBLE_DRIVER => Error::Device(no_device()),
        code => failed("vkCreateInstance")(code),
    })?;
    let debug = has_debug.then(|| ext::debug_utils::Instance::new(entry, &instance));
    Ok((instance, debug))
}

fn create_debug_messenger(
    debug: &ext::debug_utils::Instance,
    messages: &Mutex<Vec<String>>,
) -> Result<vk::DebugUtilsMessengerEXT> {
    use vk::{
        DebugUtilsMessageSeverityFlagsEXT as Severity, DebugUtilsMessageTypeFlagsEXT as Type,
    };
    let info = vk::DebugUtilsMessengerCreateInfoEXT::default()
        .message_severity(Severity::ERROR | Severity::WARNING)
        // Not PERFORMANCE: it warns about the GENERAL layout, which all images use so that one
        // memory barrier between passes suffices.
        .message_type(Type::VALIDATION)
        .pfn_user_callback(Some(debug_callback))
        .user_data(messages as *const _ as *mut c_void);
    // SAFETY: `messages` is boxed in the Device, which destroys the messenger before dropping the
    // box.
    unsafe { debug.create_debug_utils_messenger(&info, None) }
        .map_err(failed("vkCreateDebugUtilsMessengerEXT"))
}

unsafe extern "system" fn debug_callback(
    _severity: vk::DebugUtilsMessageSeverityFlagsEXT,
    _kind: vk::DebugUtilsMessageTypeFlagsEXT,
    data: *const vk::DebugUtilsMessengerCallbackDataEXT<'_>,
    messages: *mut c_void,
) -> vk::Bool32 {
    // SAFETY: the layer passes valid data, and the pointer that `create_debug_messenger`
    // registered.
    let (message, messages) =
        unsafe { ((*data).message_as_c_str(), &*(messages as *const Mutex<Vec<String>>)) };
    let message = message.map_or(String::new(), |message| message.to_string_lossy().into_owned());
    messages.lock().unwrap_or_else(|poisoned| poisoned.into_inner()).push(message);
    vk::FALSE
}

fn no_device() -> String {
    format!("no Vulkan device: {}", drivers::advice())
}

/// A device, and whether it lacks 64-bit atomics.
type Choice = (vk::PhysicalDevice, bool);

fn choose(instance: &ash::Instance, options: &DeviceOptions) -> Result<Choice> {
    let wanted = options.device.as_deref();
    // SAFETY: plain query of a live instance.
    let devices = unsafe { instance.enumerate_physical_devices() }.map_err(|code| match code {
        // Drivers without their cards.
        vk::Result::ERROR_INITIALIZATION_FAILED => Error::Device(no_device()),
        code => failed("vkEnumeratePhysicalDevices")(code),
    })?;
    let rank = |kind| match kind {
        vk::PhysicalDeviceType::DISCRETE_GPU => 0,
        vk::PhysicalDeviceType::INTEGRATED_GPU => 1,
        vk::PhysicalDeviceType::VIRTUAL_GPU => 2,
        _ => 3,
    };
    let mut fit = Vec::new();
    let mut unfit = Vec::new();
    for (index, &device) in devices.iter().enumerate() {
        // SAFETY: the device comes from this instance.
        let properties = unsafe { instance.get_physical_device_properties(device) };
        let name = text(&properties.device_name);
        let matches = wanted.is_none_or(|wanted| match wanted.parse::<usize>() {
            Ok(wanted) => wanted == index,
            Err(_) => name.to_lowercase().contains(&wanted.to_lowercase()),
        });
        if !matches {
            continue;
        }
        let mut missing = requirements::check(instance, device);
        if options.window && !has_extension(instance, device, khr::swapchain::NAME) {
            missing.push("swapchains".into());
        }
        if missing.is_empty() {
            let no_int64 = !requirements::has_optional(instance, device);
            fit.push((rank(properties.device_type), index, (device, no_int64)));
        } else {
            unfit.push(format!("{name} lacks {}", missing.join(", ")));
        }
    }
    fit.sort_by_key(|&(rank, index, _)| (rank, index));
    fit.into_iter().next().map(|(_, _, choice)| choice).ok_or_else(|| {
        Error::Device(match (devices.is_empty(), unfit.is_empty(), wanted) {
            (true, ..) => no_device(),
            (_, false, _) => {
                format!("no usable Vulkan device: {}; {}", unfit.join("; "), drivers::advice())
            }
            (_, _, wanted) => format!(
                "no device matches --device {}; there are: {}",
                wanted.unwrap_or(""),
                list(instance, &devices)
            ),
        })
    })
}

fn has_extension(instance: &ash::Instance, device: vk::PhysicalDevice, name: &CStr) -> bool {
    // SAFETY: plain query.
    let extensions =
        unsafe { instance.enumerate_device_extension_properties(device) }.unwrap_or_default();
    extensions.iter().any(|extension| extension.extension_name_as_c_str() == Ok(name))
}

fn open_device(
    instance: &ash::Instance,
    physical: vk::PhysicalDevice,
    family: u32,
    int64_atomics: bool,
    window: bool,
) -> Result<ash::Device> {
    // Devices on top of another interface, such as Metal, have the second one, and must be opened
    // with it.
    let extensions = [
        window.then_some(khr::swapchain::NAME),
        has_extension(instance, physical, khr::portability_subset::NAME)
            .then_some(khr::portability_subset::NAME),
    ];
    let extensions: Vec<_> = extensions.into_iter().flatten().map(CStr::as_ptr).collect();
    let priorities = [1.0];
    let queues = [vk::DeviceQueueCreateInfo::default()
        .queue_family_index(family)
        .queue_priorities(&priorities)];
    let mut features = Features::default();
    requirements::wanted(int64_atomics).for_each(|feature| feature.enable(&mut features));
    let Features { v10, v12, v13 } = &mut features;
    let info = vk::DeviceCreateInfo::default()
        .queue_create_infos(&queues)
        .enabled_extension_names(&extensions)
        .enabled_features(v10)
        .push_next(v12)
        .push_next(v13);
    // SAFETY: every pointer in `info` outlives the call, and `check` has found the features.
    unsafe { instance.create_device(physical, &info, None) }.map_err(failed("vkCreateDevice"))
}

fn queue_family(instance: &ash::Instance, physical: vk::PhysicalDevice) -> Option<u32> {
    // SAFETY: plain query.
    let families = unsafe { instance.get_physical_device_queue_family_properties(physical) };
    let needed = vk::QueueFlags::GRAPHICS | vk::QueueFlags::COMPUTE;
    families.iter().position(|family| family.queue_flags.contains(needed)).map(|index| index as u32)
}

/// Returns the driver's name and version, and the largest allocation `[bytes]`.
fn driver(instance: &ash::Instance, physical: vk::PhysicalDevice) -> (String, u64) {
    let mut driver = vk::PhysicalDeviceDriverProperties::default();
    let mut limits = vk::PhysicalDeviceMaintenance3Properties::default();
    let mut properties =
        vk::PhysicalDeviceProperties2::default().push_next(&mut driver).push_next(&mut limits);
    // SAFETY: the structures belong to Vulkan 1.2, which every chosen device has.
    unsafe { instance.get_physical_device_properties2(physical, &mut properties) };
    let name =
        format!("{} {}", text(&driver.driver_name), text(&driver.driver_info)).trim().to_string();
    (name, limits.max_memory_allocation_size)
}

fn text(characters: &[c_char]) -> String {
    let bytes: Vec<u8> = characters.iter().take_while(|&&c| c != 0).map(|&c| c as u8).collect();
    String::from_utf8_lossy(&bytes).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use vk::MemoryPropertyFlags as Flags;

    /// Builds memory properties from heap sizes `[MiB]` and, for each type, its heap and flags.
    fn memory(heaps: &[u64], types: &[(u32, Flags)]) -> vk::PhysicalDeviceMemoryProperties {
        let mut memory = vk::PhysicalDeviceMemoryProperties::default();
        (memory.memory_heap_count, memory.memory_type_count) =
            (heaps.len() as u32, types.len() as u32);
        heaps.iter().zip(&mut memory.memory_heaps).for_each(|(&mib, heap)| heap.size = mib << 20);
        for (&(heap_index, property_flags), kind) in types.iter().zip(&mut memory.memory_types) {
            *kind = vk::MemoryType { property_flags, heap_index };
        }
        memory
    }

    #[test]
    fn memory_is_mapped_where_all_of_the_device_s_own_is() {
        let (own, host) = (Flags::DEVICE_LOCAL, Flags::HOST_VISIBLE | Flags::HOST_COHERENT);
        for (what, heaps, types, expected) in [
            ("a software or integrated device", &[8192][..], &[(0, own | host)][..], true),
            (
                "a card with a resizable BAR",
                &[8192, 16384],
                &[(0, own), (1, host), (0, own | host)],
                true,
            ),
            ("a card without", &[8192, 16384, 256], &[(0, own), (1, host), (2, own | host)], false),
            ("a card that maps none of its memory", &[8192, 16384], &[(0, own), (1, host)], false),
        ] {
            assert_eq!(has_host_visible_vram(&memory(heaps, types)), expected, "{what}");
        }
    }
}
