//! Passes and their uses of resources in, barriers and memory out. Pure, and tested as text.
//!
//! 1. Backwards: a pass none of whose writes is wanted or read by a later kept pass is dropped.
//! 2. Forwards: before a pass goes one barrier where it reads what an earlier pass wrote since the last barrier (read after write), overwrites what was
//!    read (write after read) or written (write after write). One global memory barrier a pass at most: with every image in GENERAL nothing finer is needed.
//! 3. A transient's memory is free after its last use, and the next transient of the same description, or the next buffer that is not larger, takes it. Its new owner's first
//!    write then follows the old owner's uses like any other hazard. What a pass that looks at nothing but its own pixels reads for the last time, it may write over.

use super::{Access, BufferDesc, ImageDesc, Place, ResourceId};
use std::fmt;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Shape {
    Image(ImageDesc),
    Buffer(BufferDesc),
}

#[derive(Clone, Debug)]
pub struct Resource {
    pub name: String,
    pub shape: Shape,
}

#[derive(Clone, Debug)]
pub struct Pass {
    pub name: String,
    pub uses: Vec<(ResourceId, Access)>,
    /// Nothing is read of an image but the pixel that is written.
    pub own_pixels: bool,
}

/// A pass that will run.
#[derive(Clone, Debug)]
pub struct Step {
    /// Index into the recorded passes.
    pub pass: usize,
    pub barrier: bool,
}

#[derive(Clone, Debug)]
pub struct Plan {
    pub steps: Vec<Step>,
    /// Which memory each resource lives in; `None` for one that no kept pass uses.
    pub memory: Vec<Option<usize>>,
    pub shapes: Vec<Shape>,
    text: String,
}

pub fn plan(passes: &[Pass], resources: &[Resource], wanted: &[ResourceId]) -> Plan {
    let kept = kept(passes, resources.len(), wanted);
    let last_use = last_uses(passes, &kept, resources.len(), wanted);

    let mut plan = Plan { steps: Vec::new(), memory: vec![None; resources.len()], shapes: Vec::new(), text: String::new() };
    let mut free: Vec<usize> = Vec::new();
    // What has happened to each memory since the last barrier.
    let (mut read, mut written) = (Vec::<bool>::new(), Vec::<bool>::new());
    for (index, pass) in passes.iter().enumerate().filter(|&(index, _)| kept[index]) {
        // A resource that is bound twice gives its memory back once.
        let given_back: Vec<ResourceId> = (pass.uses.iter().enumerate())
            .filter(|&(place, (id, _))| last_use[id.0] == Some(index) && pass.uses[..place].iter().all(|(before, _)| before != id))
            .map(|(_, &(id, _))| id)
            .filter(|id| matches!(resources[id.0].shape, Shape::Image(_) | Shape::Buffer(BufferDesc { place: Place::Device, .. })))
            .collect();
        let early = |id: &ResourceId| {
            pass.own_pixels
                && matches!(resources[id.0].shape, Shape::Image(_))
                && pass.uses.iter().filter(|(other, _)| other == id).all(|(_, access)| *access == Access::Read)
        };
        let (before, after): (Vec<ResourceId>, Vec<ResourceId>) = given_back.into_iter().partition(early);
        for id in before {
            free.extend(plan.memory[id.0]);
        }
        for &(id, access) in &pass.uses {
            let resource = &resources[id.0];
            if plan.memory[id.0].is_none() {
                let transient =
                    !matches!(resource.shape, Shape::Buffer(BufferDesc { place: Place::Upload | Place::Download | Place::Imported, .. }));
                assert!(!transient || access == Access::Write, "{} reads {}, which nothing has written", pass.name, resource.name);
                let reused = transient.then(|| take(&mut free, &plan.shapes, resource.shape)).flatten();
                let memory = reused.unwrap_or_else(|| {
                    plan.shapes.push(resource.shape);
                    read.push(false);
                    written.push(false);
                    plan.shapes.len() - 1
                });
                plan.memory[id.0] = Some(memory);
            }
        }
        let at = |id: ResourceId| plan.memory[id.0].expect("given above");
        let hazard = pass.uses.iter().any(|&(id, access)| written[at(id)] || (access != Access::Read && read[at(id)]));
        if hazard {
            read.fill(false);
            written.fill(false);
        }
        for &(id, access) in &pass.uses {
            read[at(id)] |= access != Access::Write;
            written[at(id)] |= access != Access::Read;
        }
        free.extend(after.into_iter().map(at));
        plan.steps.push(Step { pass: index, barrier: hazard });
    }
    plan.text = text(&plan, passes, resources, &kept);
    plan
}

/// Of the free memory, what was freed last of the same shape; of a buffer the least that it fits into, if that is not far too large.
fn take(free: &mut Vec<usize>, shapes: &[Shape], wanted: Shape) -> Option<usize> {
    let fits = |memory: usize| match (shapes[memory], wanted) {
        (Shape::Buffer(has), Shape::Buffer(wants)) => has.place == wants.place && (wants.bytes..=4 * wants.bytes).contains(&has.bytes),
        (has, wants) => has == wants,
    };
    let room = |memory: usize| bytes(&shapes[memory]);
    let (place, _) = free.iter().enumerate().filter(|&(_, &memory)| fits(memory)).rev().min_by_key(|&(_, &memory)| room(memory))?;
    Some(free.remove(place))
}

fn kept(passes: &[Pass], resources: usize, wanted: &[ResourceId]) -> Vec<bool> {
    let mut needed = vec![false; resources];
    wanted.iter().for_each(|id| needed[id.0] = true);
    let mut kept = vec![false; passes.len()];
    for (index, pass) in passes.iter().enumerate().rev() {
        kept[index] = pass.uses.iter().any(|&(id, access)| access != Access::Read && needed[id.0]);
        if kept[index] {
            pass.uses.iter().filter(|(_, access)| *access != Access::Write).for_each(|(id, _)| needed[id.0] = true);
        }
    }
    kept
}

fn last_uses(passes: &[Pass], kept: &[bool], resources: usize, wanted: &[ResourceId]) -> Vec<Option<usize>> {
    let mut last = vec![None; resources];
    for (index, pass) in passes.iter().enumerate().filter(|&(index, _)| kept[index]) {
        pass.uses.iter().for_each(|(id, _)| last[id.0] = Some(index));
    }
    // What is wanted after the frame is never free within it.
    wanted.iter().for_each(|id| last[id.0] = None);
    last
}

/// Lines: more than any layer of a frame has.
const LONGEST_BLOCK: usize = 160;

/// Blocks of lines, up to a whole layer, that follow each other three times and more are written once, with how often.
fn folded(lines: &[String]) -> String {
    let repeats = |at: usize, length: usize| {
        let block = &lines[at..at + length];
        lines[at..].chunks_exact(length).take_while(|other| *other == block).count()
    };
    let (mut out, mut at) = (String::new(), 0);
    while at < lines.len() {
        let longest = LONGEST_BLOCK.min(lines.len() - at);
        let (length, times) = (1..=longest).map(|length| (length, repeats(at, length))).find(|(_, times)| *times > 2).unwrap_or((1, 1));
        out.extend(lines[at..at + length].iter().map(String::as_str));
        if times > 1 {
            out += &format!("  .. {} times the last {length} lines\n", times);
        }
        at += length * times;
    }
    out
}

fn text(plan: &Plan, passes: &[Pass], resources: &[Resource], kept: &[bool]) -> String {
    use fmt::Write;
    let mut lines = Vec::new();
    for step in &plan.steps {
        let pass = &passes[step.pass];
        let names = |wanted: fn(Access) -> bool| {
            let named = |&&(id, access): &&(ResourceId, Access)| wanted(access).then(|| resources[id.0].name.as_str()).is_some();
            let mut names: Vec<_> = pass.uses.iter().filter(named).map(|(id, _)| resources[id.0].name.as_str()).collect();
            // A resource may be bound twice, as texels and as words.
            names.dedup();
            names.join(", ")
        };
        if step.barrier {
            lines.push("  -- barrier\n".to_string());
        }
        let (from, to) = (names(|access| access == Access::Read), names(|access| access != Access::Read));
        lines.push(format!("  {:<12} {}{}{}\n", pass.name, from, if from.is_empty() { "-> " } else { " -> " }, to));
    }
    let mut out = folded(&lines);
    let dropped: Vec<_> = passes.iter().zip(kept).filter(|(_, kept)| !**kept).map(|(pass, _)| pass.name.as_str()).collect();
    if !dropped.is_empty() {
        writeln!(out, "  dropped, because nobody reads what they write: {}", dropped.join(", ")).unwrap();
    }
    for (memory, shape) in plan.shapes.iter().enumerate() {
        let owners: Vec<_> = (0..resources.len()).filter(|&i| plan.memory[i] == Some(memory)).map(|i| resources[i].name.as_str()).collect();
        let what = match shape {
            Shape::Image(desc) => format!("{} x {} {:?}", desc.size[0], desc.size[1], desc.format),
            Shape::Buffer(desc) => format!("{:?} buffer", desc.place).to_lowercase(),
        };
        if matches!(shape, Shape::Buffer(BufferDesc { place: Place::Imported, .. })) {
            continue;
        }
        writeln!(out, "  memory {memory}: {} = {} bytes for {}", what, bytes(shape), owners.join(", then ")).unwrap();
    }
    writeln!(out, "  total: {} passes, {} barriers, {} bytes", plan.steps.len(), plan.barriers(), plan.bytes()).unwrap();
    out
}

fn bytes(shape: &Shape) -> u64 {
    match shape {
        Shape::Image(desc) => desc.bytes(),
        // Imported memory is not the frame's.
        Shape::Buffer(BufferDesc { place: Place::Imported, .. }) => 0,
        Shape::Buffer(desc) => desc.bytes,
    }
}

impl Plan {
    pub fn barriers(&self) -> usize {
        self.steps.iter().filter(|step| step.barrier).count()
    }

    pub fn bytes(&self) -> u64 {
        self.shapes.iter().map(bytes).sum()
    }
}

impl fmt::Display for Plan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const IMAGE: Shape = Shape::Image(ImageDesc { size: [8, 8], format: ash::vk::Format::R32_SFLOAT });

    fn frame(images: usize, passes: &[(&str, &[usize], &[usize])], wanted: &[usize]) -> Plan {
        let resources: Vec<_> = (0..images).map(|i| Resource { name: format!("r{i}"), shape: IMAGE }).collect();
        let passes: Vec<_> = passes
            .iter()
            .map(|(name, reads, writes)| Pass {
                name: name.to_string(),
                uses: reads
                    .iter()
                    .map(|&i| (ResourceId(i), Access::Read))
                    .chain(writes.iter().map(|&i| (ResourceId(i), Access::Write)))
                    .collect(),
                own_pixels: name.starts_with("own"),
            })
            .collect();
        plan(&passes, &resources, &wanted.iter().map(|&i| ResourceId(i)).collect::<Vec<_>>())
    }

    #[test]
    fn read_after_write_gets_one_barrier_and_a_second_reader_none() {
        let plan = frame(4, &[("a", &[], &[0, 1]), ("b", &[0], &[2]), ("c", &[1], &[3])], &[0, 1, 2, 3]);
        assert_eq!(plan.steps.iter().map(|step| step.barrier).collect::<Vec<_>>(), [false, true, false]);
    }

    #[test]
    fn write_after_read_and_write_after_write_get_barriers() {
        let plan = frame(2, &[("a", &[], &[0]), ("b", &[0], &[1]), ("c", &[], &[0]), ("d", &[], &[0])], &[0, 1]);
        assert_eq!(plan.steps.iter().map(|step| step.barrier).collect::<Vec<_>>(), [false, true, true, true]);
    }

    #[test]
    fn a_pass_that_nobody_reads_is_dropped_and_takes_its_sources_with_it() {
        let plan = frame(3, &[("a", &[], &[0]), ("b", &[0], &[1]), ("c", &[], &[2])], &[2]);
        assert_eq!(plan.steps.len(), 1);
        assert_eq!(plan.memory, [None, None, Some(0)]);
    }

    #[test]
    fn memory_of_the_same_description_is_reused_after_its_last_use_with_a_barrier() {
        let plan = frame(4, &[("a", &[], &[0]), ("b", &[0], &[1]), ("c", &[1], &[2]), ("d", &[2], &[3])], &[3]);
        assert_eq!(plan.memory, [Some(0), Some(1), Some(0), Some(1)]);
        assert_eq!(plan.barriers(), 3);
    }

    #[test]
    fn what_a_pass_binds_twice_is_reused_once() {
        let plan = frame(4, &[("a", &[], &[0]), ("b", &[0, 0], &[1]), ("c", &[1], &[2]), ("d", &[1, 2], &[3])], &[3]);
        assert_eq!(plan.memory, [Some(0), Some(1), Some(0), Some(2)]);
    }

    #[test]
    fn a_pass_of_its_own_pixels_writes_over_what_it_reads_for_the_last_time() {
        let plan = frame(4, &[("a", &[], &[0, 1]), ("own b", &[0, 1], &[2]), ("c", &[1, 2], &[3])], &[3]);
        assert_eq!(plan.memory, [Some(0), Some(1), Some(0), Some(2)]);
        assert_eq!(plan.steps.iter().map(|step| step.barrier).collect::<Vec<_>>(), [false, true, true]);
    }

    #[test]
    fn a_buffer_takes_the_least_free_one_that_it_fits_into_and_no_giant() {
        let buffer = |bytes| Shape::Buffer(BufferDesc { bytes, place: Place::Device });
        let shapes = [100, 40, 50, 1000].map(buffer);
        let mut free = vec![0, 1, 2, 3];
        assert_eq!(take(&mut free, &shapes, buffer(45)), Some(2));
        assert_eq!(take(&mut free, &shapes, buffer(45)), Some(0));
        assert_eq!(take(&mut free, &shapes, buffer(45)), None);
    }

    #[test]
    #[should_panic(expected = "b reads r1, which nothing has written")]
    fn reading_what_nothing_has_written_panics_with_names() {
        frame(3, &[("a", &[], &[0]), ("b", &[1], &[2])], &[2]);
    }
}
