//! A host whose work is in other command buffers than the renderer's: of the same submission, or of
//! a queue of another family.
//!
//! A device of one family, as those of software are, gets another from a layer below validation
//! (`tests/support/faulty_layer.c`), in a process of its own.

use super::ownership::half;
use super::*;
use crate::faulty_layer::{self, Layer};
use pointillist::error::Result;
use pointillist::renderer::enable_features;

/// Half of a transfer of the target between families.
#[derive(Clone, Copy, PartialEq)]
enum Half {
    Release,
    Acquisition,
}

/// A device of the host's own, with a queue of the renderer's family and one of another.
struct Queues {
    /// Has the instance, whose messages it gets.
    opened: Device,
    raw: ash::Device,
    /// Families of the host's work and of the renderer's; the same if there is one queue.
    families: [u32; 2],
}

/// The host's command buffers before and after the renderer's, each with its pool.
type Commands = [(vk::CommandPool, vk::CommandBuffer); 3];

impl Queues {
    /// Opens a device for work of a family.
    fn open(theirs: Option<u32>) -> Queues {
        let opened =
            Device::open(&DeviceOptions { validate: true, ..DeviceOptions::default() }).unwrap();
        let families = [theirs.unwrap_or(opened.family), opened.family];
        let (mut v12, mut v13) = (
            vk::PhysicalDeviceVulkan12Features::default(),
            vk::PhysicalDeviceVulkan13Features::default(),
        );
        let mut features =
            vk::PhysicalDeviceFeatures2::default().push_next(&mut v12).push_next(&mut v13);
        let chain = (&raw mut features).cast();
        // SAFETY: the chain is valid, and the device has what it enables.
        unsafe { enable_features(chain, opened.int64_atomics) }.unwrap();
        let queue = |family: &u32| {
            vk::DeviceQueueCreateInfo::default()
                .queue_family_index(*family)
                .queue_priorities(&[1.0])
        };
        let distinct = if theirs.is_some() { &families[..] } else { &families[..1] };
        let queues: Vec<_> = distinct.iter().map(queue).collect();
        let info =
            vk::DeviceCreateInfo::default().queue_create_infos(&queues).push_next(&mut features);
        // SAFETY: a plain creation; destroyed in drop.
        let raw = unsafe { opened.instance.create_device(opened.physical, &info, None) }.unwrap();
        Queues { opened, raw, families }
    }

    fn transfers(&self) -> bool {
        self.families[0] != self.families[1]
    }

    fn commands(&self) -> Commands {
        let [theirs, own] = self.families;
        [theirs, own, theirs].map(|family| {
            let flags = vk::CommandPoolCreateFlags::RESET_COMMAND_BUFFER;
            let info = vk::CommandPoolCreateInfo::default().queue_family_index(family).flags(flags);
            // SAFETY: plain creations; destroyed with the pool.
            unsafe {
                let pool = self.raw.create_command_pool(&info, None).unwrap();
                let info = vk::CommandBufferAllocateInfo::default()
                    .command_pool(pool)
                    .command_buffer_count(1);
                (pool, self.raw.allocate_command_buffers(&info).unwrap()[0])
            }
        })
    }

    /// Submits the three command buffers, one after another, and waits: at once, or to two queues.
    ///
    /// # Safety
    /// They are recorded.
    unsafe fn submit(&self, commands: &Commands, semaphores: &[vk::Semaphore; 2]) {
        let [before, frame, after] = commands.map(|(_, commands)| [commands]);
        let [started, drawn] = semaphores.map(|semaphore| [semaphore]);
        let stages = [vk::PipelineStageFlags::ALL_COMMANDS];
        let info = vk::SubmitInfo::default;
        // SAFETY: as the caller ensures.
        unsafe {
            let [theirs, own] = self.families.map(|family| self.raw.get_device_queue(family, 0));
            if self.transfers() {
                let first = info().command_buffers(&before).signal_semaphores(&started);
                let second = info().command_buffers(&frame).wait_semaphores(&started);
                let second = second.wait_dst_stage_mask(&stages).signal_semaphores(&drawn);
                let third = info().command_buffers(&after).wait_semaphores(&drawn);
                let third = third.wait_dst_stage_mask(&stages);
                for (queue, work) in [(theirs, first), (own, second), (theirs, third)] {
                    self.raw.queue_submit(queue, &[work], vk::Fence::null()).unwrap();
                }
            } else {
                let all = [before, frame, after].concat();
                let work = [info().command_buffers(&all)];
                self.raw.queue_submit(own, &work, vk::Fence::null()).unwrap();
            }
            self.raw.device_wait_idle().unwrap();
        }
    }

    /// Draws a cloud over pixels that the host's command buffers write before, and read afterwards.
    /// The host may forget its half of a transfer. Errors if the validation layers say something.
    fn drawn(
        &self,
        path: &std::path::Path,
        camera: Camera,
        pixels: &[[u8; 4]],
        forgotten: Option<Half>,
    ) -> Result<Vec<u8>> {
        let (raw, commands) = (&self.raw, self.commands());
        use vk::ImageUsageFlags as Usage;
        let usage = Usage::COLOR_ATTACHMENT | Usage::TRANSFER_SRC | Usage::TRANSFER_DST;
        let image = HostImage::on(&self.opened, raw, COLOR, usage);
        let [theirs, own] = self.families;
        let family = if self.transfers() { theirs } else { Access::SAME_FAMILY };
        let access = |layout: vk::ImageLayout| Access { family, ..Access::any(layout.as_raw()) };
        let target = Target {
            image: image.image.as_raw(),
            view: image.view.as_raw(),
            format: COLOR.as_raw(),
            size: SIZE,
            samples: 1,
            before: access(vk::ImageLayout::TRANSFER_DST_OPTIMAL),
            after: access(vk::ImageLayout::TRANSFER_SRC_OPTIMAL),
            clear: false,
        };
        let host = Host {
            get_instance_proc_addr: self.opened.entry.static_fn().get_instance_proc_addr
                as *const std::ffi::c_void,
            instance: self.opened.instance.handle().as_raw(),
            physical_device: self.opened.physical.as_raw(),
            device: raw.handle().as_raw(),
            queue_family: own,
            has_int64_atomics: self.opened.int64_atomics,
            has_debug_utils: true,
            allocation_callbacks: std::ptr::null(),
            allocate_memory: std::ptr::null(),
            free_memory: std::ptr::null(),
        };
        let drawn = vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL.as_raw();
        // SAFETY: every object is alive, each frame is waited for, and the renderer is dropped
        // before the device.
        unsafe {
            let bytes = 4 * PIXELS as u64;
            let usage = vk::BufferUsageFlags::TRANSFER_SRC | vk::BufferUsageFlags::TRANSFER_DST;
            let info = vk::BufferCreateInfo::default().size(bytes).usage(usage);
            let buffer = raw.create_buffer(&info, None).unwrap();
            let needs = raw.get_buffer_memory_requirements(buffer);
            use vk::MemoryPropertyFlags as Flags;
            let flags = Flags::HOST_VISIBLE | Flags::HOST_COHERENT;
            let memory = allocate(&self.opened, raw, needs, flags);
            raw.bind_buffer_memory(buffer, memory, 0).unwrap();
            let mapped = raw.map_memory(memory, 0, bytes, Default::default()).unwrap();
            let semaphores = [(); 2].map(|()| raw.create_semaphore(&Default::default(), None));
            let semaphores = semaphores.map(|made| made.unwrap());

            let mut renderer = Renderer::new(&host, RendererOptions::default()).unwrap();
            renderer.open(&[path.into()], &OpenSettings::default()).unwrap();
            let [(_, before), (_, frame), (_, after)] = commands;
            let barrier = |commands, layouts, families| {
                let half = [half(&target, layouts, families)];
                let info = vk::DependencyInfo::default().image_memory_barriers(&half);
                raw.cmd_pipeline_barrier2(commands, &info);
            };
            let mut said = Ok(());
            for number in 1..2000 {
                std::ptr::copy_nonoverlapping(pixels.as_ptr(), mapped.cast(), PIXELS);
                for (_, commands) in commands {
                    raw.begin_command_buffer(commands, &Default::default()).unwrap();
                }
                let written = vk::ImageLayout::TRANSFER_DST_OPTIMAL;
                image.transition(raw, before, vk::ImageLayout::UNDEFINED, written);
                let regions = [image.region(0)];
                raw.cmd_copy_buffer_to_image(before, buffer, image.image, written, &regions);
                if self.transfers() && forgotten != Some(Half::Release) {
                    barrier(before, [target.before.layout, drawn], [theirs, own]);
                }
                let views = [view_of(camera)];
                let targets = Targets::of(target);
                let asked = Frame { number, safe: number - 1, targets, views: &views };
                let report = renderer.record(frame.as_raw(), &asked).unwrap();
                if self.transfers() && forgotten != Some(Half::Acquisition) {
                    barrier(after, [drawn, target.after.layout], [own, theirs]);
                }
                // The buffer is written after it was read, and then read by the CPU.
                use vk::{AccessFlags2 as Accesses, PipelineStageFlags2 as Stage};
                let ordered = |from: (Stage, Accesses), to: (Stage, Accesses)| {
                    let barrier = [vk::MemoryBarrier2::default()
                        .src_stage_mask(from.0)
                        .src_access_mask(from.1)
                        .dst_stage_mask(to.0)
                        .dst_access_mask(to.1)];
                    let info = vk::DependencyInfo::default().memory_barriers(&barrier);
                    raw.cmd_pipeline_barrier2(after, &info);
                };
                let written = (Stage::COPY, Accesses::TRANSFER_WRITE);
                ordered((Stage::COPY, Accesses::TRANSFER_READ), written);
                let read = vk::ImageLayout::TRANSFER_SRC_OPTIMAL;
                raw.cmd_copy_image_to_buffer(after, image.image, read, buffer, &regions);
                ordered(written, (Stage::HOST, Accesses::HOST_READ));
                commands.iter().for_each(|(_, commands)| {
                    raw.end_command_buffer(*commands).unwrap();
                });
                self.submit(&commands, &semaphores);
                said = self.opened.take_validation_errors();
                if said.is_err() || report.settled && report.points > 0 {
                    break;
                }
                assert!(number < 1999, "the picture never settles");
                std::thread::sleep(std::time::Duration::from_millis(5));
            }
            drop(renderer);
            let picture = std::slice::from_raw_parts(mapped.cast(), 4 * PIXELS).to_vec();
            semaphores.iter().for_each(|semaphore| raw.destroy_semaphore(*semaphore, None));
            commands.iter().for_each(|(pool, _)| raw.destroy_command_pool(*pool, None));
            raw.destroy_image_view(image.view, None);
            raw.destroy_image(image.image, None);
            raw.free_memory(image.memory, None);
            raw.destroy_buffer(buffer, None);
            raw.free_memory(memory, None);
            said.map(|()| picture)
        }
    }
}

impl Drop for Queues {
    fn drop(&mut self) {
        // SAFETY: all that was made on it is gone.
        unsafe { self.raw.destroy_device(None) };
    }
}

/// Returns a picture of the scan over the host's pixels, all in one command buffer.
fn in_one_command_buffer(path: &std::path::Path, camera: Camera, pixels: &[[u8; 4]]) -> Vec<u8> {
    let mut application = Application::new(COLOR);
    let mut renderer = application.renderer();
    renderer.open(&[path.into()], &OpenSettings::default()).unwrap();
    let mut targets = application.targets();
    application.settle(&mut renderer, targets, &[view_of(camera)]);
    let copied = Access::any(vk::ImageLayout::TRANSFER_DST_OPTIMAL.as_raw());
    for target in [Some(&mut targets.color), targets.depth.as_mut()].into_iter().flatten() {
        (target.clear, target.before) = (false, copied);
    }
    // Nothing of the host is nearer.
    let held = Some((pixels.as_flattened(), &[0.0; PIXELS][..]));
    application.draw(&mut renderer, targets, &[view_of(camera)], held).1
}

#[test]
fn the_hosts_work_may_be_in_other_command_buffers_and_in_another_queue_family() {
    let folder = tempfile::tempdir().unwrap();
    let (path, camera) = scan(folder.path());
    let pixels = vec![[9, 80, 200, 255]; PIXELS];
    let expected = in_one_command_buffer(&path, camera, &pixels);
    let one = Queues::open(None);
    let picture = one.drawn(&path, camera, &pixels, None).unwrap();
    assert!(picture == expected, "in one submission");
    let (instance, own) = (&one.opened.instance, one.opened.family);
    // SAFETY: a plain query of a live instance.
    let all = unsafe { instance.get_physical_device_queue_family_properties(one.opened.physical) };
    use vk::QueueFlags as Flags;
    let works = Flags::GRAPHICS | Flags::COMPUTE | Flags::TRANSFER;
    let others = (0..all.len() as u32).zip(&all).filter(|(family, found)| {
        *family != own && found.queue_count > 0 && found.queue_flags.intersects(works)
    });
    let others: Vec<u32> = others.map(|(family, _)| family).collect();
    drop(one);
    let mut checked = 0;
    for &theirs in &others {
        let picture = Queues::open(Some(theirs)).drawn(&path, camera, &pixels, None).unwrap();
        assert!(picture == expected, "in queue family {theirs}");
        for forgotten in [Half::Release, Half::Acquisition] {
            let queues = Queues::open(Some(theirs));
            let said = queues.drawn(&path, camera, &pixels, Some(forgotten)).unwrap_err();
            let said = said.to_string();
            println!("{said}");
            let expected = match forgotten {
                Half::Release => "no matching release barrier",
                Half::Acquisition => "VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL",
            };
            assert!(said.contains(expected), "{said}");
        }
        checked += 1;
        println!("the host's work is in family {theirs} of {}, ours in {own}", all.len());
    }
    if checked > 0 {
        return;
    }
    assert!(std::env::var_os("SHOWN").is_none(), "the layer shows no queue family");
    if faulty_layer::build(folder.path()) {
        let [layers, path] = faulty_layer::environment(folder.path(), Layer::BelowValidation);
        let printed = again(&[("SHOWN", "1".into()), layers, path]);
        assert!(printed.contains("the host's work is in family 1 of 2"), "the test did not run");
    }
}
