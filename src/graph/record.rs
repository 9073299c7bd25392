//! Records a plan, and submits it or leaves that to a host: the only place that records compute
//! passes.
//!
//! Every pass has a debug label, a timestamp pair and a breadcrumb.

use super::plan::{Memory, Plan, Shape, Step};
use super::submission::Submission;
use super::{
    Access, BufferDesc, Code, CompletedSubmission, Gpu, Graph, Groups, Import, Kind, LAYOUT, Pause,
    Place, ResourceId, Work, too_large,
};
use crate::error::{Error, Result};
use crate::gpu::breadcrumbs::Breadcrumbs;
use crate::gpu::kernel::descriptor_type;
use crate::gpu::memory::{Block, RawBuffer, RawImage, Texels};
use crate::gpu::timing::Timing;
use crate::gpu::{LogicalDevice, failed, raster};
use crate::progress::Progress;
use ash::vk;
use std::collections::HashMap;
use std::time::{Duration, Instant};

enum PhysicalResource {
    Image(RawImage),
    /// A buffer with its own memory.
    Buffer(RawBuffer),
    /// A buffer owned elsewhere, or by a block.
    Borrowed(Import),
}

/// Resources of a submission.
#[derive(Default)]
struct Resources {
    blocks: Vec<Block>,
    /// Memory by index of the plan's memory.
    physical: HashMap<usize, PhysicalResource>,
}

impl PhysicalResource {
    fn buffer(&self) -> (vk::Buffer, Texels) {
        match self {
            PhysicalResource::Buffer(buffer) => (buffer.raw, buffer.texels),
            PhysicalResource::Borrowed(import) => (import.raw, import.texels),
            PhysicalResource::Image(_) => {
                unreachable!("the handle's type says that it is a buffer")
            }
        }
    }

    fn image(&self) -> &RawImage {
        match self {
            PhysicalResource::Image(image) => image,
            _ => unreachable!("the handle's type says that it is an image"),
        }
    }
}

/// A submission in flight, with all that it uses.
#[must_use = "what it uses is free again only when it is finished"]
pub struct PendingSubmission {
    submission: Submission,
    recorded: Recorded,
}

/// Recorded commands, with all that they use until the device has completed them.
#[must_use = "what it uses is free again only when it is finished"]
pub struct Recorded {
    plan: Plan,
    names: Vec<String>,
    held: Resources,
    timing: Timing,
    breadcrumbs: Breadcrumbs,
    /// Dropped with the rest.
    _recorder: Recorder,
}

/// Plans are submitted by us.
pub(super) fn launch<'g>(
    graph: Graph<'g>,
    plan: Plan,
    wanted: &[ResourceId],
    pause: Option<&mut Pause>,
) -> Result<(PendingSubmission, &'g mut Gpu)> {
    let progress = graph.progress;
    let is_output = |step: &Step| {
        let mut uses = graph.passes[step.pass].uses.iter();
        uses.any(|(id, access)| *access != Access::Read && wanted.contains(id))
    };
    let until = plan.steps.iter().position(is_output).unwrap_or(plan.steps.len());
    let (recorded, submission, gpu) = record(graph, plan, |gpu, recording| {
        let submission = Submission::new(gpu)?;
        submission.begin()?;
        let parts = Parts { submission: &submission, progress, pause, until };
        // Others are done before one could pause, and cannot be interrupted.
        let parts = Some(parts).filter(|_| gpu.device.is_cpu);
        let recorded = recording.steps(gpu, submission.commands, parts)?;
        submission.submit_rest(gpu, &recorded.1)?;
        Ok((recorded, submission))
    })?;
    Ok((PendingSubmission { recorded, submission }, gpu))
}

/// Records a plan into a command buffer that a host submits.
pub(super) fn into_host<'g>(
    graph: Graph<'g>,
    plan: Plan,
    commands: vk::CommandBuffer,
) -> Result<(Recorded, &'g mut Gpu)> {
    let (recorded, (), gpu) =
        record(graph, plan, |gpu, recording| Ok((recording.steps(gpu, commands, None)?, ())))?;
    Ok((recorded, gpu))
}

/// A plan with its memory, to be recorded.
struct Recording<'r> {
    plan: &'r Plan,
    names: &'r [String],
    work: &'r [Work],
    physical: &'r HashMap<usize, PhysicalResource>,
    barriers: bool,
}

/// What recording the steps makes.
type Steps = (Timing, Breadcrumbs, Recorder);

/// Allocates what a plan uses, and has `steps` record it.
fn record<'g, T>(
    graph: Graph<'g>,
    plan: Plan,
    steps: impl FnOnce(&mut Gpu, Recording) -> Result<(Steps, T)>,
) -> Result<(Recorded, T, &'g mut Gpu)> {
    let Graph {
        gpu,
        passes,
        work,
        resources,
        uploads,
        imports,
        persistent,
        progress: _,
        predicate: _,
        wanted: _,
        tile_mask: _,
        reused: _,
        answers: _,
        without_barriers,
    } = graph;
    let names: Vec<String> = plan.steps.iter().map(|step| passes[step.pass].name.clone()).collect();
    let mut held = Resources::default();
    let begun = allocate(gpu, &plan, &resources, uploads, &imports, &mut held).and_then(|()| {
        let (plan, names, work, physical) = (&plan, &names[..], &work[..], &held.physical);
        steps(gpu, Recording { plan, names, work, physical, barriers: !without_barriers })
    });
    let ((timing, breadcrumbs, recorder), made) = begun?;
    // Buffers that no pass of the plan uses have not been filled. Later submissions start when this
    // one is done.
    let filled = persistent.into_iter().filter(|(id, ..)| plan.memory[id.0].is_some());
    filled.for_each(|(_, name, cache_key, steps)| {
        gpu.memory.set_persistent_state(&name, Some((cache_key, steps)))
    });
    let recorded = Recorded { plan, names, held, timing, breadcrumbs, _recorder: recorder };
    Ok((recorded, made, gpu))
}

impl PendingSubmission {
    /// Returns whether [`PendingSubmission::finish`] returns at once.
    pub fn is_done(&self) -> bool {
        self.submission.is_done()
    }

    /// Waits until the device is done.
    pub fn finish(self, gpu: &mut Gpu) -> Result<CompletedSubmission> {
        let PendingSubmission { recorded, submission } = self;
        let waited = submission
            .wait(&recorded.breadcrumbs)
            .and_then(|()| gpu.check_simulated_loss(&recorded.breadcrumbs));
        recorded.complete(gpu, waited)
    }
}

impl Recorded {
    /// Returns the memory of an image that was requested.
    pub fn image(&self, image: &super::Image) -> RawImage {
        let memory = self.plan.memory[image.id.0].expect("an image that was requested");
        *self.held.physical[&memory].image()
    }

    /// Returns name and device time of each pass `[ms]`; the device must have completed the
    /// commands.
    pub fn times(&self) -> Result<impl Iterator<Item = (&str, f64)>> {
        Ok(self.names.iter().map(String::as_str).zip(self.timing.read()?))
    }

    /// Returns the contents of a download; the device must have completed the commands.
    pub fn read<T: bytemuck::Pod>(&self, download: &super::Buffer) -> &[T] {
        let memory = self.plan.memory[download.id.0].expect("a buffer from Graph::download");
        let PhysicalResource::Buffer(raw) = &self.held.physical[&memory] else {
            unreachable!("downloads have memory of their own")
        };
        bytemuck::cast_slice(&raw.bytes()[..download.desc.bytes as usize])
    }

    /// Returns the results after the device has completed the commands, or failed to.
    fn complete(self, gpu: &Gpu, waited: Result<()>) -> Result<CompletedSubmission> {
        let Recorded { plan, names, held, timing, .. } = self;
        let done = waited
            .and_then(|()| timing.read())
            .and_then(|times| gpu.device.take_validation_errors().map(|()| times));
        let downloads = downloads(&plan, held);
        Ok(CompletedSubmission { passes: names.into_iter().zip(done?).collect(), plan, downloads })
    }
}

impl Gpu {
    /// Fails if tests pretend that the device is lost.
    fn check_simulated_loss(&self, breadcrumbs: &Breadcrumbs) -> Result<()> {
        match self.overrides.lost_after {
            Some(submissions) if self.submitted >= submissions => {
                Err(breadcrumbs.blame(vk::Result::ERROR_DEVICE_LOST))
            }
            _ => Ok(()),
        }
    }
}

/// Returns the downloads of a completed frame; the rest is dropped.
fn downloads(plan: &Plan, held: Resources) -> Vec<(ResourceId, RawBuffer)> {
    let owner = |memory| {
        plan.memory.iter().position(|&m| m == Some(memory)).expect("every memory has an owner")
    };
    let download = |(memory, item)| match item {
        PhysicalResource::Buffer(buffer) if buffer.desc.place == Place::Download => {
            Some((ResourceId(owner(memory)), buffer))
        }
        _ => None,
    };
    held.physical.into_iter().filter_map(download).collect()
}

/// Steps of a software device between checks for cancellation: each may compile for a second, and a
/// submission costs a tenth of a millisecond.
const STEPS_PER_FLUSH: usize = 4;

/// Time of a part of a submission between two pauses: short beside the tenth of a second in which a
/// panel answers.
const PART: Duration = Duration::from_millis(10);

/// How a submission to a software device is cut into parts.
struct Parts<'p, 'q> {
    submission: &'p Submission,
    progress: Option<&'p dyn Progress>,
    pause: Option<&'p mut Pause<'q>>,
    /// The step that first writes an output: all from there on is one part.
    until: usize,
}

impl Parts<'_, '_> {
    /// Checks for cancellation.
    fn before(
        &self,
        gpu: &Gpu,
        breadcrumbs: &Breadcrumbs,
        order: usize,
        steps: usize,
    ) -> Result<()> {
        let Some(progress) =
            self.progress.filter(|_| order > 0 && order.is_multiple_of(STEPS_PER_FLUSH))
        else {
            return Ok(());
        };
        self.submission.flush(gpu, breadcrumbs)?;
        progress.tick("drawing", order as u64, steps as u64)
    }

    /// Returns how many rows of a kernel's workgroups are a part, by its pace of the last time.
    fn rows(&self, gpu: &Gpu, kernel: &str, order: usize, all: u32) -> u32 {
        if self.pause.is_none() || order >= self.until {
            return all;
        }
        const AT_FIRST: u32 = 16;
        let fitting = |pace: &f64| (PART.as_secs_f64() / pace.max(1e-9)) as u32;
        gpu.paces.get(kernel).map_or(all / AT_FIRST, fitting).clamp(1, all)
    }

    /// Ends a part of this many rows, and pauses.
    fn after(
        &mut self,
        gpu: &mut Gpu,
        breadcrumbs: &Breadcrumbs,
        kernel: &'static str,
        order: usize,
        rows: u32,
    ) -> Result<()> {
        let Some(pause) = self.pause.as_mut().filter(|_| order < self.until) else {
            return Ok(());
        };
        let began = Instant::now();
        self.submission.flush(gpu, breadcrumbs)?;
        gpu.paces.insert(kernel, began.elapsed().as_secs_f64() / rows as f64);
        pause(gpu)
    }
}

impl Work {
    /// Returns the kernel of a pass, and the rows of workgroups that may be dispatched one by one;
    /// shaders step by the length of a row.
    fn rows(&self) -> (&'static str, u32) {
        match self {
            Work::Run { code, groups: Groups::Fixed([_, rows, _]), .. } => (code.name, *rows),
            Work::Run { code, .. } => (code.name, 1),
            _ => ("", 1),
        }
    }
}

impl Recording<'_> {
    /// Records the steps. Every submission shares persistent buffers and recycled memory with
    /// others, so the first step waits for all earlier work of the queue.
    fn steps(
        self,
        gpu: &mut Gpu,
        commands: vk::CommandBuffer,
        mut parts: Option<Parts>,
    ) -> Result<Steps> {
        let Recording { plan, names, work, physical, barriers } = self;
        let timing = Timing::new(&gpu.device, names.len() as u32)?;
        let kernel = |step: &Step| match &work[step.pass] {
            Work::Run { code, constants, .. } => Some((code, constants)),
            _ => None,
        };
        gpu.kernels.prepare(&gpu.device, &gpu.workers, plan.steps.iter().filter_map(kernel))?;
        let recorder = Recorder::new(gpu, plan, work, commands)?;
        let breadcrumbs = Breadcrumbs::new(&gpu.device, &mut gpu.memory, names.to_vec())?;
        let recorded = (|| {
            timing.reset(commands);
            for (order, step) in plan.steps.iter().enumerate() {
                if let Some(parts) = &parts {
                    parts.before(gpu, &breadcrumbs, order, plan.steps.len())?;
                }
                let label = std::ffi::CString::new(names[order].as_str()).unwrap_or_default();
                breadcrumbs.mark(&gpu.device, commands, order);
                if order == 0 || (step.barrier && barriers) {
                    let discards = step.discards.iter().map(|memory| physical[memory].image());
                    barrier(gpu, commands, discards);
                }
                timing.mark(commands, order, false);
                let at = |id: &ResourceId| {
                    &physical[&plan.memory[id.0].expect("a kept pass's resource has memory")]
                };
                let work = &work[step.pass];
                let bound = recorder.bind(gpu, work, at)?;
                let ((kernel, rows), mut first) = (work.rows(), 0);
                // A pass without workgroups is recorded, too.
                while first < rows.max(1) {
                    let left = rows - first;
                    let some = parts.as_ref().map_or(left, |parts| {
                        parts.rows(gpu, kernel, order, left.max(1)).min(left)
                    });
                    if let Some(labels) = &gpu.device.labels {
                        // SAFETY: the command buffer is being recorded; the label outlives the
                        // call.
                        unsafe {
                            labels.cmd_begin_debug_utils_label(
                                commands,
                                &vk::DebugUtilsLabelEXT::default().label_name(&label),
                            )
                        };
                    }
                    recorder.pass(gpu, work, &bound, [first, some], at);
                    first += some.max(1);
                    if first >= rows {
                        timing.mark(commands, order, true);
                    }
                    if let Some(labels) = &gpu.device.labels {
                        // SAFETY: closes the label opened above.
                        unsafe { labels.cmd_end_debug_utils_label(commands) };
                    }
                    if let Some(parts) = &mut parts {
                        parts.after(gpu, &breadcrumbs, kernel, order, some.max(1))?;
                    }
                }
            }
            // For downloads, and for what a host's command buffer has next.
            let mut last = full_barrier();
            last.dst_stage_mask |= vk::PipelineStageFlags2::HOST;
            last.dst_access_mask |= vk::AccessFlags2::HOST_READ;
            let last = [last];
            // SAFETY: recorded outside of rendering.
            unsafe {
                gpu.device.raw.cmd_pipeline_barrier2(
                    commands,
                    &vk::DependencyInfo::default().memory_barriers(&last),
                )
            };
            Ok(())
        })();
        recorded.map(|()| (timing, breadcrumbs, recorder))
    }
}

/// Allocates the plan's memory; uploads have their own.
fn allocate(
    gpu: &mut Gpu,
    plan: &Plan,
    resources: &[super::plan::Resource],
    uploads: Vec<(ResourceId, RawBuffer)>,
    imports: &[(ResourceId, Import)],
    held: &mut Resources,
) -> Result<()> {
    let Resources { blocks, physical } = held;
    for (id, import) in imports {
        plan.memory[id.0]
            .map(|memory| physical.insert(memory, PhysicalResource::Borrowed(*import)));
    }
    for (id, raw) in uploads {
        if let Some(memory) = plan.memory[id.0] {
            physical.insert(memory, PhysicalResource::Buffer(raw));
        }
    }
    let name = |memory| {
        let owner =
            plan.memory.iter().position(|&m| m == Some(memory)).expect("every memory has an owner");
        &resources[owner].name
    };
    for (memory, Memory { shape, .. }) in plan.memories.iter().enumerate() {
        check_limits(gpu, name(memory), shape)?;
    }
    for requirements in &plan.blocks {
        blocks.push(gpu.memory.block(*requirements)?);
    }
    for (memory, Memory { shape, within }) in plan.memories.iter().enumerate() {
        let Gpu { memory: of_device, device, .. } = &mut *gpu;
        let item = match (shape, within) {
            (Shape::Image(desc), Some((block, bytes))) => PhysicalResource::Image(
                of_device.image(device, &mut blocks[*block], bytes.start, *desc, name(memory))?,
            ),
            (Shape::Buffer(desc), Some((block, bytes))) => {
                let (raw, texels) = of_device.buffer_in(
                    device,
                    &mut blocks[*block],
                    bytes.start,
                    *desc,
                    name(memory),
                )?;
                PhysicalResource::Borrowed(Import { raw, texels })
            }
            (Shape::Buffer(desc), None) if !physical.contains_key(&memory) => {
                PhysicalResource::Buffer(of_device.buffer(device, *desc, name(memory))?)
            }
            _ => continue,
        };
        physical.insert(memory, item);
    }
    Ok(())
}

/// Checks sizes against the device's limits before anything is created.
fn check_limits(gpu: &Gpu, name: &str, shape: &Shape) -> Result<()> {
    let limits = &gpu.device.limits;
    match shape {
        Shape::Image(desc)
            if desc.size.iter().any(|&side| side > limits.max_image_dimension2_d) =>
        {
            let ([width, height], limit) = (desc.size, limits.max_image_dimension2_d);
            Err(Error::Request(format!(
                "a picture of {width} x {height} pixels is beyond this device's {limit} a side; ask for a smaller --size"
            )))
        }
        Shape::Buffer(BufferDesc { place: Place::Device, bytes })
            if *bytes > limits.max_storage_buffer_range as u64 =>
        {
            Err(too_large(name, *bytes, limits.max_storage_buffer_range as u64))
        }
        _ => Ok(()),
    }
}

fn full_barrier() -> vk::MemoryBarrier2<'static> {
    vk::MemoryBarrier2::default()
        .src_stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)
        .src_access_mask(vk::AccessFlags2::MEMORY_WRITE)
        .dst_stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)
        .dst_access_mask(vk::AccessFlags2::MEMORY_READ | vk::AccessFlags2::MEMORY_WRITE)
}

/// Records a barrier after all earlier work. Images with undefined contents go to GENERAL, where
/// they stay.
fn barrier<'a>(
    gpu: &Gpu,
    commands: vk::CommandBuffer,
    discards: impl Iterator<Item = &'a RawImage>,
) {
    let all = full_barrier();
    let images: Vec<_> = discards
        .map(|image| {
            vk::ImageMemoryBarrier2::default()
                .src_stage_mask(all.src_stage_mask)
                .src_access_mask(all.src_access_mask)
                .dst_stage_mask(all.dst_stage_mask)
                .dst_access_mask(all.dst_access_mask)
                .old_layout(vk::ImageLayout::UNDEFINED)
                .new_layout(LAYOUT)
                .image(image.raw)
                .subresource_range(image.desc.whole())
        })
        .collect();
    let all = [all];
    // SAFETY: recorded between passes, outside of rendering; the images live until the submission
    // has been waited for.
    unsafe {
        gpu.device.raw.cmd_pipeline_barrier2(
            commands,
            &vk::DependencyInfo::default().memory_barriers(&all).image_memory_barriers(&images),
        )
    };
}

/// What a pass binds; nothing for copies.
#[derive(Default)]
struct Bound {
    pipeline: vk::Pipeline,
    layout: vk::PipelineLayout,
    /// Sets of the compute shader, or of the vertex and the fragment shader.
    sets: [vk::DescriptorSet; 2],
}

/// Records passes into a command buffer, with descriptors from a pool of its own.
struct Recorder {
    device: LogicalDevice,
    commands: vk::CommandBuffer,
    descriptors: vk::DescriptorPool,
}

impl Drop for Recorder {
    fn drop(&mut self) {
        // SAFETY: the commands have been completed, or were never submitted.
        unsafe { self.device.destroy(self.descriptors) };
    }
}

impl Recorder {
    fn new(gpu: &Gpu, plan: &Plan, work: &[Work], commands: vk::CommandBuffer) -> Result<Recorder> {
        let device = gpu.device.raw.clone();
        let (mut sets, mut buffers, mut texels, mut images) = (0, 0, 0, 0);
        for step in &plan.steps {
            let stages = match &work[step.pass] {
                Work::Run { code, .. } => std::slice::from_ref(code),
                Work::Draw { draw, .. } => draw.stages,
                _ => &[],
            };
            for code in stages {
                sets += 1;
                for binding in code.bindings {
                    match binding.kind {
                        Kind::Buffer => buffers += 1,
                        Kind::TexelsR32ui | Kind::TexelsRgba32ui => texels += 1,
                        _ => images += 1,
                    }
                }
            }
        }
        let size = |ty, count: u32| vk::DescriptorPoolSize { ty, descriptor_count: count.max(1) };
        let sizes = [
            size(vk::DescriptorType::STORAGE_BUFFER, buffers),
            size(vk::DescriptorType::STORAGE_TEXEL_BUFFER, texels),
            size(vk::DescriptorType::STORAGE_IMAGE, images),
        ];
        let info = vk::DescriptorPoolCreateInfo::default().max_sets(sets.max(1)).pool_sizes(&sizes);
        // SAFETY: a plain creation on a live device, destroyed in `drop`.
        let descriptors = unsafe { device.make(&info) }?.keep();
        Ok(Recorder { device, commands, descriptors })
    }

    /// Allocates and writes the descriptor set of a stage. `last` is the last binding's view if
    /// `resources` has none.
    fn set<'p>(
        &self,
        layout: vk::DescriptorSetLayout,
        code: &Code,
        resources: &[ResourceId],
        last: Option<vk::BufferView>,
        at: &impl Fn(&ResourceId) -> &'p PhysicalResource,
    ) -> Result<vk::DescriptorSet> {
        let layouts = [layout];
        let info = vk::DescriptorSetAllocateInfo::default()
            .descriptor_pool(self.descriptors)
            .set_layouts(&layouts);
        // SAFETY: the pool was sized for exactly these sets.
        let set = unsafe { self.device.allocate_descriptor_sets(&info) }
            .map_err(failed("vkAllocateDescriptorSets"))?[0];
        let whole = |raw| [vk::DescriptorBufferInfo::default().buffer(raw).range(vk::WHOLE_SIZE)];
        let (mut buffers, mut texels, mut images) = (Vec::new(), Vec::new(), Vec::new());
        for (binding, id) in code.bindings.iter().zip(resources) {
            match binding.kind {
                Kind::TexelsR32ui => texels.push((binding, [at(id).buffer().1.words])),
                Kind::TexelsRgba32ui => texels.push((binding, [at(id).buffer().1.fours])),
                Kind::Buffer => buffers.push((binding, whole(at(id).buffer().0))),
                _ => images.push((
                    binding,
                    [vk::DescriptorImageInfo::default()
                        .image_view(at(id).image().view)
                        .image_layout(LAYOUT)],
                )),
            }
        }
        texels.extend(code.bindings.last().zip(last).map(|(binding, words)| (binding, [words])));
        let write = |binding: &crate::gpu::Binding| {
            vk::WriteDescriptorSet::default()
                .dst_set(set)
                .dst_binding(binding.bind)
                .descriptor_type(descriptor_type(binding.kind))
        };
        let mut writes: Vec<_> =
            buffers.iter().map(|(binding, info)| write(binding).buffer_info(info)).collect();
        writes.extend(texels.iter().map(|(binding, view)| write(binding).texel_buffer_view(view)));
        writes.extend(images.iter().map(|(binding, info)| write(binding).image_info(info)));
        // SAFETY: kinds and formats were checked when the pass was recorded; everything lives until
        // the fence.
        unsafe { self.device.update_descriptor_sets(&writes, &[]) };
        Ok(set)
    }

    /// Makes what a pass binds.
    fn bind<'p>(
        &self,
        gpu: &mut Gpu,
        work: &Work,
        at: impl Fn(&ResourceId) -> &'p PhysicalResource,
    ) -> Result<Bound> {
        Ok(match work {
            Work::Run { code, constants, resources, .. } => {
                // A shader without a tile list still needs a buffer bound for it, which it never
                // reads.
                let no_tiles = match code.listed {
                    Some(_) if resources.len() < code.bindings.len() => Some(
                        gpu.memory
                            .persistent_buffer(&gpu.device, "no area", 64, &[])?
                            .0
                            .texels
                            .words,
                    ),
                    _ => None,
                };
                let kernel = gpu.kernels.get(&gpu.device, code, constants)?;
                let set = self.set(kernel.set_layout, code, resources, no_tiles, &at)?;
                let (pipeline, layout) = (kernel.pipeline, kernel.layout);
                Bound { pipeline, layout, sets: [set, vk::DescriptorSet::null()] }
            }
            Work::Draw { draw, resources, attachments, .. } => {
                let [color, depth] = attachments.each_ref().map(|id| at(id).image());
                let pipeline =
                    gpu.raster.get(&gpu.device, draw, raster::Target::of(color, depth))?;
                let mut sets = [vk::DescriptorSet::null(); 2];
                for (stage, set) in sets.iter_mut().enumerate() {
                    *set = self.set(
                        pipeline.set_layouts[stage],
                        &draw.stages[stage],
                        &resources[stage],
                        None,
                        &at,
                    )?;
                }
                Bound { pipeline: pipeline.pipeline, layout: pipeline.layout, sets }
            }
            _ => Bound::default(),
        })
    }

    /// Records a pass: of its rows of workgroups a number from the first on.
    fn pass<'p>(
        &self,
        gpu: &Gpu,
        work: &Work,
        bound: &Bound,
        [first, rows]: [u32; 2],
        at: impl Fn(&ResourceId) -> &'p PhysicalResource,
    ) {
        match work {
            Work::Run { push, groups, .. } => {
                let bind = vk::PipelineBindPoint::COMPUTE;
                // SAFETY: the generated types fix the sizes of push constants; everything lives
                // until the fence.
                unsafe {
                    self.device.cmd_bind_pipeline(self.commands, bind, bound.pipeline);
                    self.device.cmd_bind_descriptor_sets(
                        self.commands,
                        bind,
                        bound.layout,
                        0,
                        &bound.sets[..1],
                        &[],
                    );
                    if !push.is_empty() {
                        self.device.cmd_push_constants(
                            self.commands,
                            bound.layout,
                            vk::ShaderStageFlags::COMPUTE,
                            0,
                            push,
                        );
                    }
                    match groups {
                        Groups::Fixed([x, y, z]) if rows == *y => {
                            self.device.cmd_dispatch(self.commands, *x, *y, *z)
                        }
                        Groups::Fixed([x, _, z]) => {
                            self.device.cmd_dispatch_base(self.commands, 0, first, 0, *x, rows, *z)
                        }
                        Groups::Indirect(list, byte) => self.device.cmd_dispatch_indirect(
                            self.commands,
                            at(list).buffer().0,
                            *byte,
                        ),
                    }
                }
            }
            Work::Draw { draw, vertices, attachments, .. } => {
                let [color, depth] = attachments.each_ref().map(|id| at(id).image());
                let bind = vk::PipelineBindPoint::GRAPHICS;
                // SAFETY: as above.
                unsafe {
                    self.device.cmd_bind_pipeline(self.commands, bind, bound.pipeline);
                    self.device.cmd_bind_descriptor_sets(
                        self.commands,
                        bind,
                        bound.layout,
                        0,
                        &bound.sets,
                        &[],
                    );
                    for (code, flags) in draw
                        .stages
                        .iter()
                        .zip([vk::ShaderStageFlags::VERTEX, vk::ShaderStageFlags::FRAGMENT])
                    {
                        if code.push_bytes > 0 {
                            self.device.cmd_push_constants(
                                self.commands,
                                bound.layout,
                                flags,
                                0,
                                &draw.push,
                            );
                        }
                    }
                }
                raster::record(
                    &gpu.device,
                    self.commands,
                    draw,
                    vertices.as_ref().map(|id| at(id).buffer().0),
                    color,
                    depth,
                );
            }
            Work::Fill { buffer: id, word } => {
                // SAFETY: the buffer was made with TRANSFER_DST.
                unsafe {
                    self.device.cmd_fill_buffer(
                        self.commands,
                        at(id).buffer().0,
                        0,
                        vk::WHOLE_SIZE,
                        *word,
                    )
                };
            }
            Work::Discard => {}
            Work::CopyBuffer { from, to, bytes } => {
                let region = vk::BufferCopy::default().size(*bytes);
                // SAFETY: both buffers have at least this many bytes.
                unsafe {
                    self.device.cmd_copy_buffer(
                        self.commands,
                        at(from).buffer().0,
                        at(to).buffer().0,
                        &[region],
                    )
                };
            }
            Work::CopyParts { from, to, parts } => {
                let region = |&[from, to, bytes]: &[u64; 3]| {
                    vk::BufferCopy::default().src_offset(from).dst_offset(to).size(bytes)
                };
                let regions: Vec<_> = parts.iter().map(region).collect();
                // SAFETY: the recorder ensures that both buffers have these bytes, and that no two
                // parts overlap in `to`.
                unsafe {
                    self.device.cmd_copy_buffer(
                        self.commands,
                        at(from).buffer().0,
                        at(to).buffer().0,
                        &regions,
                    )
                };
            }
            Work::CopyImage { from, to } => {
                let [from, to] = [from, to].map(|id| at(id).image());
                let [width, height] = from.desc.size;
                let color = vk::ImageSubresourceLayers {
                    aspect_mask: vk::ImageAspectFlags::COLOR,
                    layer_count: 1,
                    ..Default::default()
                };
                let region = vk::ImageCopy::default()
                    .src_subresource(color)
                    .dst_subresource(color)
                    .extent(vk::Extent3D { width, height, depth: 1 });
                // SAFETY: both images have the same size and format.
                unsafe {
                    self.device.cmd_copy_image(
                        self.commands,
                        from.raw,
                        LAYOUT,
                        to.raw,
                        LAYOUT,
                        &[region],
                    )
                };
            }
            Work::CopyOut { image: from, buffer: to } => {
                let from = at(from).image();
                let depth = from.desc.format == vk::Format::D32_SFLOAT;
                let aspect =
                    if depth { vk::ImageAspectFlags::DEPTH } else { vk::ImageAspectFlags::COLOR };
                let [width, height] = from.desc.size;
                let region = vk::BufferImageCopy::default()
                    .image_extent(vk::Extent3D { width, height, depth: 1 })
                    .image_subresource(vk::ImageSubresourceLayers {
                        aspect_mask: aspect,
                        layer_count: 1,
                        ..Default::default()
                    });
                // SAFETY: the buffer was made for exactly these pixels.
                unsafe {
                    self.device.cmd_copy_image_to_buffer(
                        self.commands,
                        from.raw,
                        LAYOUT,
                        at(to).buffer().0,
                        &[region],
                    )
                };
            }
        }
    }
}
