//! Images that another queue family owns before and after a frame.
//!
//! The other family is that of another device or process, to which images are given and from which
//! they are taken in the same way; `families` has queues of two families of one device.

use super::*;
use crate::counting::{ImageBarrier, image_barriers};

/// The host's half of a transfer of one target.
pub(super) fn half(
    target: &Target,
    layouts: [i32; 2],
    families: [u32; 2],
) -> vk::ImageMemoryBarrier2<'static> {
    let stage = vk::PipelineStageFlags2::ALL_COMMANDS;
    let access = vk::AccessFlags2::MEMORY_READ | vk::AccessFlags2::MEMORY_WRITE;
    vk::ImageMemoryBarrier2::default()
        .src_stage_mask(stage)
        .dst_stage_mask(stage)
        .src_access_mask(access)
        .dst_access_mask(access)
        .old_layout(vk::ImageLayout::from_raw(layouts[0]))
        .new_layout(vk::ImageLayout::from_raw(layouts[1]))
        .src_queue_family_index(families[0])
        .dst_queue_family_index(families[1])
        .image(vk::Image::from_raw(target.image))
        .subresource_range(range(vk::Format::from_raw(target.format)))
}

/// Returns all targets, with the layouts that the renderer draws in.
fn all(targets: &Targets) -> Vec<(Target, vk::ImageLayout)> {
    let color = vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL;
    let depth = vk::ImageLayout::DEPTH_STENCIL_ATTACHMENT_OPTIMAL;
    [(Some(targets.color), color), (targets.depth, depth), (targets.ids, color)]
        .into_iter()
        .chain([(targets.normals, color)])
        .filter_map(|(target, layout)| Some((target?, layout)))
        .collect()
}

impl Application {
    /// Releases the images to their other owner, before a frame.
    pub(super) fn give_up(&self, targets: &Targets) {
        let Some(owner) = self.owner else { return };
        let halves: Vec<_> = all(targets)
            .iter()
            .filter(|(target, _)| target.before.layout != 0)
            .map(|(target, layout)| {
                let layouts = [target.before.layout, layout.as_raw()];
                half(target, layouts, [self.device.family, owner])
            })
            .collect();
        let info = vk::DependencyInfo::default().image_memory_barriers(&halves);
        // SAFETY: the command buffer is being recorded.
        unsafe { self.device.raw.cmd_pipeline_barrier2(self.commands, &info) };
    }

    /// Acquires them after the frame.
    pub(super) fn take_back(&self, targets: &Targets) {
        let Some(owner) = self.owner else { return };
        let back = |(target, layout): &(Target, vk::ImageLayout)| {
            let layouts = [layout.as_raw(), target.after.layout];
            half(target, layouts, [owner, self.device.family])
        };
        let halves: Vec<_> = all(targets).iter().map(back).collect();
        let info = vk::DependencyInfo::default().image_memory_barriers(&halves);
        // SAFETY: the command buffer is being recorded.
        unsafe { self.device.raw.cmd_pipeline_barrier2(self.commands, &info) };
    }
}

/// Images are acquired from their owner, drawn into, and released to it, with what was in them; the
/// validation layers say nothing.
#[test]
fn images_of_another_family_are_acquired_and_released() {
    let folder = tempfile::tempdir().unwrap();
    let (path, camera) = scan(folder.path());
    let drawn = [None, Some(vk::QUEUE_FAMILY_EXTERNAL)].map(|owner| {
        let mut application = Application::new(COLOR);
        let mut renderer = application.renderer();
        renderer.open(std::slice::from_ref(&path), &OpenSettings::default()).unwrap();
        application.owner = owner;
        let mut targets = application.targets();
        let family = owner.unwrap_or(Access::SAME_FAMILY);
        let owned = |targets: &mut Targets| {
            let Targets { color, depth, ids, normals, .. } = targets;
            for target in [depth, ids, normals].into_iter().flatten().chain([color]) {
                (target.before.family, target.after.family) = (family, family);
            }
        };
        owned(&mut targets);
        let (_, cleared, _) = application.settle(&mut renderer, targets, &[view_of(camera)]);
        // Over the host's pixels, which come with the images.
        let copied = Access::any(vk::ImageLayout::TRANSFER_DST_OPTIMAL.as_raw());
        for target in [Some(&mut targets.color), targets.depth.as_mut()].into_iter().flatten() {
            (target.clear, target.before) = (false, copied);
        }
        owned(&mut targets);
        let pixels = vec![[9, 80, 200, 255]; PIXELS];
        let depths: Vec<f32> = (0..PIXELS).map(|i| (i % 5) as f32 * 0.002).collect();
        let (mut over, mut depth) = (Vec::new(), Vec::new());
        let barriers = image_barriers(|| {
            let held = Some((pixels.as_flattened(), &depths[..]));
            (_, over, depth) = application.draw(&mut renderer, targets, &[view_of(camera)], held);
        });
        let own = application.device.family;
        for (target, layout) in all(&targets) {
            let image = vk::Image::from_raw(target.image);
            let of: Vec<&ImageBarrier> =
                barriers.iter().filter(|barrier| barrier.image == image).collect();
            let [first, last] = of[..] else { panic!("{of:?}") };
            let families = |pair| if owner.is_some() { pair } else { [Access::SAME_FAMILY; 2] };
            assert_eq!(first.families, families([family, own]));
            assert_eq!(last.families, families([own, family]));
            let [to, from] = [target.before, target.after]
                .map(|access| vk::ImageLayout::from_raw(access.layout));
            assert_eq!([first.layouts, last.layouts], [[to, layout], [layout, from]]);
            let host = |access: Access| {
                let stages = vk::PipelineStageFlags2::from_raw(access.stages);
                (stages, vk::AccessFlags2::from_raw(access.access))
            };
            assert_eq!((first.stages[0], first.access[0]), host(target.before));
            assert_eq!((last.stages[1], last.access[1]), host(target.after));
            // All that draws lies between the two.
            let all = vk::PipelineStageFlags2::ALL_COMMANDS;
            assert_eq!([first.stages[1], last.stages[0]], [all; 2]);
            assert!(first.access[1].contains(vk::AccessFlags2::MEMORY_WRITE));
            assert!(last.access[0].contains(vk::AccessFlags2::MEMORY_WRITE));
        }
        (cleared, over, depth)
    });
    assert!(drawn[0] == drawn[1], "a transfer changes the picture");
    assert!(drawn[0].0 != drawn[0].1, "the host's pixels are not seen");
}
