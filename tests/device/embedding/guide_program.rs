use ash::vk::{self, Handle};
use pointillist::renderer::*;
use std::ffi::c_void;

/// Runs when the device is created: enables what the renderer needs.
unsafe fn enable(features: &mut vk::PhysicalDeviceFeatures2) -> Result<()> {
    unsafe { enable_features((features as *mut vk::PhysicalDeviceFeatures2).cast(), false) }
}

/// Runs once, on the host's device.
unsafe fn start(
    entry: &ash::Entry,
    instance: &ash::Instance,
    physical: vk::PhysicalDevice,
    device: &ash::Device,
) -> Result<Renderer> {
    let host = Host {
        get_instance_proc_addr: entry.static_fn().get_instance_proc_addr as *const c_void,
        instance: instance.handle().as_raw(),
        physical_device: physical.as_raw(),
        device: device.handle().as_raw(),
        queue_family: 0,
        has_int64_atomics: false,
        has_debug_utils: false,
        allocation_callbacks: std::ptr::null(),
        allocate_memory: std::ptr::null(),
        free_memory: std::ptr::null(),
    };
    let mut renderer = unsafe { Renderer::new(&host, RendererOptions::default()) }?;
    renderer.open(&["scan.laz".into()], &OpenSettings::default())?;
    Ok(renderer)
}

/// Runs for each frame, outside of rendering, while `commands` are recorded.
unsafe fn frame(
    renderer: &mut Renderer,
    commands: vk::CommandBuffer,
    [image, view]: [u64; 2],
    size: [u32; 2],
    number: u64,
) -> Result<FrameReport> {
    let color = Target {
        image,
        view,
        format: vk::Format::B8G8R8A8_UNORM.as_raw(),
        size,
        samples: 1,
        before: Access::any(vk::ImageLayout::UNDEFINED.as_raw()),
        after: Access::any(vk::ImageLayout::PRESENT_SRC_KHR.as_raw()),
        clear: true,
    };
    let targets = Targets::of(color);
    let camera = renderer.framing(Preset::Fit, size);
    let view = |camera| FrameView {
        camera: ViewCamera::Camera { camera, near: 0.01, far: f64::INFINITY },
        area: Area { corner: [0, 0], size },
    };
    let views: Vec<FrameView> = camera.map(view).into_iter().collect();
    // Two frames are in flight: the one before the last is completed.
    let frame = Frame { number, safe: number.saturating_sub(2), targets, views: &views };
    unsafe { renderer.record(commands.as_raw(), &frame) }
}
