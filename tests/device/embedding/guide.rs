//! The program of the guide, in a host that has nothing but Vulkan.

use super::range;

// What the guide has, word by word.
include!("guide_program.rs");

const TEXT: &str = include_str!("guide_program.rs");
const GUIDE: &str = include_str!("../../../src/guide/embedding.md");
const SIZE: [u32; 2] = [320, 240];
const FORMAT: vk::Format = vk::Format::B8G8R8A8_UNORM;

#[test]
fn the_program_of_the_guide_draws_a_cloud_in_sixty_lines() {
    let [_, after] = *GUIDE.split("```no_run\n").collect::<Vec<_>>() else { panic!("one program") };
    assert_eq!(after.split_once("```").unwrap().0, TEXT, "tests/device/embedding/guide_program.rs");
    let is_code = |line: &&str| !line.trim().is_empty() && !line.trim().starts_with("//");
    let lines = TEXT.lines().filter(is_code).count();
    println!("{lines} lines");
    assert!(lines <= 60, "{lines} lines");

    let folder = tempfile::tempdir().unwrap();
    let scene = pointillist::synth::SceneKind::Torus;
    crate::files::scan(&folder.path().join("scan.laz"), scene, 100_000);
    // The program reads scan.laz where it is started; each test has a process of its own.
    std::env::set_current_dir(&folder).unwrap();
    // SAFETY: the host below is one of a single queue, which is waited for at the end.
    let pixels = unsafe { drawn() };
    let background = pixels[..4].to_vec();
    let seen = pixels.chunks(4).filter(|pixel| *pixel != background).count();
    println!("{seen} pixels show points");
    assert!(seen > 10_000, "{seen} pixels");
}

/// Draws until the picture is complete. Returns its pixels.
unsafe fn drawn() -> Vec<u8> {
    // SAFETY: plain Vulkan; all that is made is destroyed at the end, after the queue.
    unsafe {
        let entry = ash::Entry::load().unwrap();
        let application = vk::ApplicationInfo::default().api_version(vk::API_VERSION_1_3);
        let surface = [ash::khr::surface::NAME.as_ptr()];
        let info = vk::InstanceCreateInfo::default()
            .application_info(&application)
            .enabled_extension_names(&surface);
        let instance = entry.create_instance(&info, None).unwrap();
        let physical = instance.enumerate_physical_devices().unwrap()[0];
        let (mut v12, mut v13) = (
            vk::PhysicalDeviceVulkan12Features::default(),
            vk::PhysicalDeviceVulkan13Features::default(),
        );
        let mut features =
            vk::PhysicalDeviceFeatures2::default().push_next(&mut v12).push_next(&mut v13);
        enable(&mut features).unwrap();
        let queues = [vk::DeviceQueueCreateInfo::default().queue_priorities(&[1.0])];
        // Images of a swapchain are presented afterwards.
        let extensions = [ash::khr::swapchain::NAME.as_ptr()];
        let info = vk::DeviceCreateInfo::default()
            .queue_create_infos(&queues)
            .enabled_extension_names(&extensions)
            .push_next(&mut features);
        let device = instance.create_device(physical, &info, None).unwrap();
        let queue = device.get_device_queue(0, 0);
        let flags = vk::CommandPoolCreateFlags::RESET_COMMAND_BUFFER;
        let info = vk::CommandPoolCreateInfo::default().flags(flags);
        let pool = device.create_command_pool(&info, None).unwrap();
        let info =
            vk::CommandBufferAllocateInfo::default().command_pool(pool).command_buffer_count(1);
        let commands = device.allocate_command_buffers(&info).unwrap()[0];

        let kinds = instance.get_physical_device_memory_properties(physical);
        let allocated = |needs: vk::MemoryRequirements, wanted: vk::MemoryPropertyFlags| {
            let kind = (0..kinds.memory_type_count).find(|&kind| {
                let has = kinds.memory_types[kind as usize].property_flags.contains(wanted);
                needs.memory_type_bits >> kind & 1 == 1 && has
            });
            let info = vk::MemoryAllocateInfo::default()
                .allocation_size(needs.size)
                .memory_type_index(kind.unwrap());
            device.allocate_memory(&info, None).unwrap()
        };
        use vk::ImageUsageFlags as Usage;
        let extent = vk::Extent3D { width: SIZE[0], height: SIZE[1], depth: 1 };
        let info = vk::ImageCreateInfo::default()
            .image_type(vk::ImageType::TYPE_2D)
            .format(FORMAT)
            .extent(extent)
            .mip_levels(1)
            .array_layers(1)
            .samples(vk::SampleCountFlags::TYPE_1)
            .usage(Usage::COLOR_ATTACHMENT | Usage::TRANSFER_SRC);
        let image = device.create_image(&info, None).unwrap();
        let needs = device.get_image_memory_requirements(image);
        let image_memory = allocated(needs, vk::MemoryPropertyFlags::DEVICE_LOCAL);
        device.bind_image_memory(image, image_memory, 0).unwrap();
        let info = vk::ImageViewCreateInfo::default()
            .image(image)
            .view_type(vk::ImageViewType::TYPE_2D)
            .format(FORMAT)
            .subresource_range(range(FORMAT));
        let view = device.create_image_view(&info, None).unwrap();
        let bytes = 4 * (SIZE[0] * SIZE[1]) as usize;
        let info = vk::BufferCreateInfo::default()
            .size(bytes as u64)
            .usage(vk::BufferUsageFlags::TRANSFER_DST);
        let buffer = device.create_buffer(&info, None).unwrap();
        let flags = vk::MemoryPropertyFlags::HOST_VISIBLE | vk::MemoryPropertyFlags::HOST_COHERENT;
        let memory = allocated(device.get_buffer_memory_requirements(buffer), flags);
        device.bind_buffer_memory(buffer, memory, 0).unwrap();

        let mut renderer = start(&entry, &instance, physical, &device).unwrap();
        let mut report = FrameReport::default();
        let mut number = 0;
        while !(report.settled && report.points > 0) {
            number += 1;
            assert!(number < 2000, "the picture never settles");
            assert!(!matches!(renderer.state(CloudId(1)).unwrap(), CloudState::Failed(_)));
            device.begin_command_buffer(commands, &Default::default()).unwrap();
            let handles = [image.as_raw(), view.as_raw()];
            report = frame(&mut renderer, commands, handles, SIZE, number).unwrap();
            let barrier = [vk::ImageMemoryBarrier2::default()
                .src_stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)
                .src_access_mask(vk::AccessFlags2::MEMORY_WRITE)
                .dst_stage_mask(vk::PipelineStageFlags2::COPY)
                .dst_access_mask(vk::AccessFlags2::TRANSFER_READ)
                .old_layout(vk::ImageLayout::PRESENT_SRC_KHR)
                .new_layout(vk::ImageLayout::TRANSFER_SRC_OPTIMAL)
                .image(image)
                .subresource_range(range(FORMAT))];
            let info = vk::DependencyInfo::default().image_memory_barriers(&barrier);
            device.cmd_pipeline_barrier2(commands, &info);
            let region = [vk::BufferImageCopy::default().image_extent(extent).image_subresource(
                vk::ImageSubresourceLayers {
                    aspect_mask: vk::ImageAspectFlags::COLOR,
                    layer_count: 1,
                    ..Default::default()
                },
            )];
            let layout = vk::ImageLayout::TRANSFER_SRC_OPTIMAL;
            device.cmd_copy_image_to_buffer(commands, image, layout, buffer, &region);
            device.end_command_buffer(commands).unwrap();
            let buffers = [commands];
            let submit = [vk::SubmitInfo::default().command_buffers(&buffers)];
            device.queue_submit(queue, &submit, vk::Fence::null()).unwrap();
            device.queue_wait_idle(queue).unwrap();
            std::thread::sleep(std::time::Duration::from_millis(2));
        }
        let mapped = device.map_memory(memory, 0, vk::WHOLE_SIZE, Default::default()).unwrap();
        let pixels = std::slice::from_raw_parts(mapped.cast::<u8>(), bytes).to_vec();
        drop(renderer);
        device.destroy_buffer(buffer, None);
        device.destroy_image_view(view, None);
        device.destroy_image(image, None);
        [memory, image_memory].iter().for_each(|memory| device.free_memory(*memory, None));
        device.destroy_command_pool(pool, None);
        device.destroy_device(None);
        instance.destroy_instance(None);
        pixels
    }
}
