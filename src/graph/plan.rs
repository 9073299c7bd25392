//! Plans barriers and memory from passes and their uses of resources. Pure, and tested as text.
//!
//! 1. Backwards: a pass is dropped if none of its writes is wanted or read by a later kept pass.
//!
//! 2. Forwards: one barrier precedes a pass that reads what an earlier pass wrote since the last
//!    barrier (read after write), or overwrites what was read (write after read) or written (write
//!    after write). One global memory barrier per pass suffices, since every image is in GENERAL.
//!
//! 3. Transients are placed in one block, large ones first, each where no other lies whose lifetime
//!    overlaps. The first write to reused bytes is a hazard against their previous uses. A pass that
//!    reads only the pixels it writes may write over an input that is read for the last time.

use super::{Access, BufferDesc, ImageDesc, Place, ResourceId};
use crate::gpu::MemoryRequirements;
use std::collections::HashMap;
use std::fmt;
use std::ops::Range;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Shape {
    Image(ImageDesc),
    Buffer(BufferDesc),
}

#[derive(Clone, Debug)]
pub struct Resource {
    pub name: String,
    pub shape: Shape,
    /// Memory requirements of a transient; `None` if the resource has memory of its own.
    pub requirements: Option<MemoryRequirements>,
}

#[derive(Clone, Debug)]
pub struct Pass {
    pub name: String,
    pub uses: Vec<(ResourceId, Access)>,
    /// True if the pass reads only the pixel that it writes.
    pub in_place: bool,
}

/// A pass that runs.
#[derive(Clone, Debug)]
pub struct Step {
    /// Index into the recorded passes.
    pub pass: usize,
    pub barrier: bool,
    /// Memories of images whose contents become undefined here: other resources lay there, or
    /// nothing yet.
    pub discards: Vec<usize>,
}

/// Memory that resources use one after the other.
#[derive(Clone, Debug)]
pub struct Memory {
    pub shape: Shape,
    /// Block and byte range; `None` for memory of its own.
    pub within: Option<(usize, Range<u64>)>,
}

#[derive(Clone, Debug)]
pub struct Plan {
    pub steps: Vec<Step>,
    /// Memory of each resource; `None` if no kept pass uses it.
    pub memory: Vec<Option<usize>>,
    pub memories: Vec<Memory>,
    /// Blocks of transients: one, or one per memory type.
    pub blocks: Vec<MemoryRequirements>,
    /// Lines of passes and barriers, and what follows them in the text of the plan.
    lines: Vec<String>,
    summary: String,
}

/// Plans the passes; `max_block` is the largest block `[bytes]`.
pub fn plan(
    passes: &[Pass],
    resources: &[Resource],
    wanted: &[ResourceId],
    max_block: u64,
) -> Plan {
    let kept = kept_passes(passes, resources.len(), wanted);
    let lifetimes = lifetimes(passes, &kept, resources.len(), wanted);
    let mut plan = Plan {
        steps: Vec::new(),
        memory: vec![None; resources.len()],
        memories: Vec::new(),
        blocks: Vec::new(),
        lines: Vec::new(),
        summary: String::new(),
    };
    let places = place(resources, &lifetimes, max_block, &mut plan.blocks);
    let mut placed: HashMap<(Shape, usize, u64), usize> = HashMap::new();
    for (index, pass) in passes.iter().enumerate().filter(|&(index, _)| kept[index]) {
        for &(id, access) in pass
            .uses
            .iter()
            .filter(|(id, _)| lifetimes[id.0].as_ref().is_some_and(|life| life.first == index))
        {
            let Resource { name, shape, requirements } = &resources[id.0];
            assert!(
                requirements.is_none() || access == Access::Write,
                "{} reads {name}, which nothing has written",
                pass.name
            );
            if plan.memory[id.0].is_none() {
                let within = places[id.0].clone();
                let mut new = || {
                    plan.memories.push(Memory { shape: *shape, within: within.clone() });
                    plan.memories.len() - 1
                };
                plan.memory[id.0] = Some(match &within {
                    Some((block, bytes)) => {
                        *placed.entry((*shape, *block, bytes.start)).or_insert_with(new)
                    }
                    None => new(),
                });
            }
        }
        plan.steps.push(Step { pass: index, barrier: false, discards: Vec::new() });
    }
    order(&mut plan, passes, &lifetimes);
    plan.lines = lines(&plan, passes, resources);
    plan.summary = summary(&plan, passes, resources, &kept);
    plan
}

/// Places barriers, and discards of images: at the last barrier before their first use, or at the
/// start.
fn order(plan: &mut Plan, passes: &[Pass], lifetimes: &[Option<Lifetime>]) {
    let memories = &plan.memories;
    let shared = |a: usize, b: usize| match (&memories[a].within, &memories[b].within) {
        (Some((one, a)), Some((other, b))) => one == other && a.start < b.end && b.start < a.end,
        _ => false,
    };
    let others: Vec<Vec<usize>> = (0..memories.len())
        .map(|a| (0..memories.len()).filter(|&b| a != b && shared(a, b)).collect())
        .collect();
    // Accesses of each memory since the last barrier, and whether it still holds its own image's
    // contents.
    let (mut read, mut written, mut own) =
        (vec![false; memories.len()], vec![false; memories.len()], vec![false; memories.len()]);
    let mut last = 0;
    for at in 0..plan.steps.len() {
        let pass = &passes[plan.steps[at].pass];
        let uses: Vec<(usize, Access)> = pass
            .uses
            .iter()
            .map(|&(id, access)| (plan.memory[id.0].expect("used"), access))
            .collect();
        let hazard = uses.iter().any(|&(memory, access)| {
            [memory]
                .iter()
                .chain(&others[memory])
                .any(|&lies| written[lies] || (access != Access::Read && read[lies]))
        });
        if hazard {
            read.fill(false);
            written.fill(false);
            last = at;
            plan.steps[at].barrier = true;
        }
        for (&(memory, access), (id, _)) in uses.iter().zip(&pass.uses) {
            let first =
                lifetimes[id.0].as_ref().is_some_and(|life| life.first == plan.steps[at].pass);
            if first && !own[memory] && matches!(memories[memory].shape, Shape::Image(_)) {
                plan.steps[last].discards.push(memory);
            }
            read[memory] |= access != Access::Write;
            written[memory] |= access != Access::Read;
            own[memory] = true;
            others[memory].iter().for_each(|&other| own[other] = false);
        }
    }
}

/// First and last pass that use a resource.
#[derive(Clone, Debug)]
struct Lifetime {
    first: usize,
    /// `usize::MAX` if it is wanted after the frame.
    last: usize,
    /// True if the last pass reads only pixels that it writes.
    in_place: bool,
}

impl Lifetime {
    /// Returns whether `next` may replace this one pixel by pixel.
    fn can_hand_over(&self, next: &Lifetime) -> bool {
        self.in_place && self.last == next.first && self.first < self.last
    }
}

fn lifetimes(
    passes: &[Pass],
    kept: &[bool],
    resources: usize,
    wanted: &[ResourceId],
) -> Vec<Option<Lifetime>> {
    let mut lifetimes: Vec<Option<Lifetime>> = vec![None; resources];
    for (index, pass) in passes.iter().enumerate().filter(|&(index, _)| kept[index]) {
        for (id, _) in &pass.uses {
            let only_read = pass
                .uses
                .iter()
                .filter(|(other, _)| other == id)
                .all(|(_, access)| *access == Access::Read);
            let first = lifetimes[id.0].as_ref().map_or(index, |life| life.first);
            lifetimes[id.0] =
                Some(Lifetime { first, last: index, in_place: pass.in_place && only_read });
        }
    }
    for id in wanted {
        lifetimes[id.0]
            .iter_mut()
            .for_each(|life| *life = Lifetime { last: usize::MAX, in_place: false, ..*life });
    }
    lifetimes
}

/// Places every transient in a block, and sizes the blocks.
fn place(
    resources: &[Resource],
    lifetimes: &[Option<Lifetime>],
    max_block: u64,
    blocks: &mut Vec<MemoryRequirements>,
) -> Vec<Option<(usize, Range<u64>)>> {
    let mut transients: Vec<(usize, MemoryRequirements, &Lifetime)> =
        (resources.iter().zip(lifetimes).enumerate())
            .filter_map(|(i, (resource, life))| Some((i, resource.requirements?, life.as_ref()?)))
            .collect();
    transients.sort_by_key(|&(i, requirements, life)| {
        (std::cmp::Reverse(requirements.bytes), life.first, i)
    });
    let mut places: Vec<Option<(usize, Range<u64>)>> = vec![None; resources.len()];
    for (rank, &(i, requirements, life)) in transients.iter().enumerate() {
        let start_in = |block: usize| {
            // Placed resources whose lifetimes overlap: their bytes, and whether this one may
            // replace them.
            let mut taken: Vec<(Range<u64>, bool)> = (transients[..rank].iter())
                .filter(|(_, _, other)| other.first <= life.last && life.first <= other.last)
                .filter_map(|&(j, _, other)| {
                    let (_, bytes) = places[j].clone().filter(|(within, _)| *within == block)?;
                    let same = resources[i].shape == resources[j].shape
                        && matches!(resources[i].shape, Shape::Image(_));
                    Some((bytes, same && (other.can_hand_over(life) || life.can_hand_over(other))))
                })
                .collect();
            taken.sort_by_key(|(bytes, _)| bytes.start);
            let crossed = |bytes: &Range<u64>| {
                taken
                    .iter()
                    .filter(|(other, _)| other.start < bytes.end && bytes.start < other.end)
                    .count()
            };
            if let Some((bytes, _)) =
                taken.iter().find(|(bytes, handed)| *handed && crossed(bytes) == 1)
            {
                return bytes.start;
            }
            let mut start = 0;
            for (bytes, _) in &taken {
                if start + requirements.bytes <= bytes.start {
                    break;
                }
                start = start.max(bytes.end.next_multiple_of(requirements.align));
            }
            start
        };
        let alike = (0..blocks.len()).filter(|&block| blocks[block].types == requirements.types);
        let (block, start) = alike
            .map(|block| (block, start_in(block)))
            .find(|(_, start)| start + requirements.bytes <= max_block)
            .unwrap_or_else(|| {
                blocks.push(MemoryRequirements { bytes: 0, ..requirements });
                (blocks.len() - 1, 0)
            });
        places[i] = Some((block, start..start + requirements.bytes));
        blocks[block] = MemoryRequirements {
            bytes: blocks[block].bytes.max(start + requirements.bytes),
            align: blocks[block].align.max(requirements.align),
            ..requirements
        };
    }
    places
}

fn kept_passes(passes: &[Pass], resources: usize, wanted: &[ResourceId]) -> Vec<bool> {
    let mut needed = vec![false; resources];
    wanted.iter().for_each(|id| needed[id.0] = true);
    let mut kept = vec![false; passes.len()];
    for (index, pass) in passes.iter().enumerate().rev() {
        kept[index] = pass.uses.iter().any(|&(id, access)| access != Access::Read && needed[id.0]);
        if kept[index] {
            pass.uses
                .iter()
                .filter(|(_, access)| *access != Access::Write)
                .for_each(|(id, _)| needed[id.0] = true);
        }
    }
    kept
}

/// Longest run of lines that is folded: more than any layer of a frame has.
const MAX_FOLDED_LINES: usize = 160;

/// Writes runs of lines that repeat three times or more only once, with their count.
fn fold_repeats(lines: &[String]) -> String {
    let repeats = |at: usize, length: usize| {
        let block = &lines[at..at + length];
        lines[at..].chunks_exact(length).take_while(|other| *other == block).count()
    };
    let (mut out, mut at) = (String::new(), 0);
    while at < lines.len() {
        let longest = MAX_FOLDED_LINES.min(lines.len() - at);
        let (length, times) = (1..=longest)
            .map(|length| (length, repeats(at, length)))
            .find(|(_, times)| *times > 2)
            .unwrap_or((1, 1));
        out.extend(lines[at..at + length].iter().map(String::as_str));
        if times > 1 {
            out += &format!("  .. {} times the last {length} lines\n", times);
        }
        at += length * times;
    }
    out
}

/// Returns the lines of passes and barriers.
fn lines(plan: &Plan, passes: &[Pass], resources: &[Resource]) -> Vec<String> {
    let mut lines = Vec::new();
    for step in &plan.steps {
        let pass = &passes[step.pass];
        let names = |wanted: fn(Access) -> bool| {
            let named = |&&(id, access): &&(ResourceId, Access)| {
                wanted(access).then(|| resources[id.0].name.as_str()).is_some()
            };
            let mut names: Vec<_> = pass
                .uses
                .iter()
                .filter(named)
                .map(|(id, _)| resources[id.0].name.as_str())
                .collect();
            // A resource may be bound twice, as texels and as words.
            names.dedup();
            names.join(", ")
        };
        if step.barrier {
            lines.push("  -- barrier\n".to_string());
        }
        let (from, to) =
            (names(|access| access == Access::Read), names(|access| access != Access::Read));
        lines.push(format!(
            "  {:<12} {}{}{}\n",
            pass.name,
            from,
            if from.is_empty() { "-> " } else { " -> " },
            to
        ));
    }
    lines
}

/// Returns what the plan says of dropped passes, of memories and of totals.
fn summary(plan: &Plan, passes: &[Pass], resources: &[Resource], kept: &[bool]) -> String {
    use fmt::Write;
    let mut out = String::new();
    let dropped: Vec<_> = passes
        .iter()
        .zip(kept)
        .filter(|(_, kept)| !**kept)
        .map(|(pass, _)| pass.name.as_str())
        .collect();
    if !dropped.is_empty() {
        writeln!(out, "  dropped, since nothing reads their outputs: {}", dropped.join(", "))
            .unwrap();
    }
    for (memory, Memory { shape, within }) in plan.memories.iter().enumerate() {
        let owners: Vec<_> = (0..resources.len())
            .filter(|&i| plan.memory[i] == Some(memory))
            .map(|i| resources[i].name.as_str())
            .collect();
        let what = match shape {
            Shape::Image(desc) => format!("{} x {} {:?}", desc.size[0], desc.size[1], desc.format),
            Shape::Buffer(desc) => format!("{:?} buffer", desc.place).to_lowercase(),
        };
        if matches!(shape, Shape::Buffer(BufferDesc { place: Place::Imported, .. })) {
            continue;
        }
        let at = within
            .as_ref()
            .map(|(_, bytes)| format!(" from byte {}", bytes.start))
            .unwrap_or_default();
        writeln!(
            out,
            "  memory {memory}: {} = {} bytes{at} for {}",
            what,
            bytes(shape),
            owners.join(", then ")
        )
        .unwrap();
    }
    writeln!(
        out,
        "  total: {} passes, {} barriers, {} bytes",
        plan.steps.len(),
        plan.barriers(),
        plan.bytes()
    )
    .unwrap();
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
        let own = self
            .memories
            .iter()
            .filter(|memory| memory.within.is_none())
            .map(|memory| bytes(&memory.shape));
        own.chain(self.blocks.iter().map(|block| block.bytes)).sum()
    }
}

impl fmt::Display for Plan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // Every frame is planned, and few plans are read: folding, which compares lines with lines,
        // waits until then.
        f.write_str(&fold_repeats(&self.lines))?;
        f.write_str(&self.summary)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const IMAGE: Shape =
        Shape::Image(ImageDesc { size: [8, 8], format: ash::vk::Format::R32_SFLOAT });

    const NEEDS: MemoryRequirements = MemoryRequirements { bytes: 256, align: 64, types: 1 };

    fn frame(images: usize, passes: &[(&str, &[usize], &[usize])], wanted: &[usize]) -> Plan {
        let resources: Vec<_> = (0..images)
            .map(|i| Resource { name: format!("r{i}"), shape: IMAGE, requirements: Some(NEEDS) })
            .collect();
        let passes: Vec<_> = passes
            .iter()
            .map(|(name, reads, writes)| Pass {
                name: name.to_string(),
                uses: reads
                    .iter()
                    .map(|&i| (ResourceId(i), Access::Read))
                    .chain(writes.iter().map(|&i| (ResourceId(i), Access::Write)))
                    .collect(),
                in_place: name.starts_with("own"),
            })
            .collect();
        plan(
            &passes,
            &resources,
            &wanted.iter().map(|&i| ResourceId(i)).collect::<Vec<_>>(),
            u64::MAX,
        )
    }

    #[test]
    fn read_after_write_gets_one_barrier_and_a_second_reader_none() {
        let plan =
            frame(4, &[("a", &[], &[0, 1]), ("b", &[0], &[2]), ("c", &[1], &[3])], &[0, 1, 2, 3]);
        assert_eq!(
            plan.steps.iter().map(|step| step.barrier).collect::<Vec<_>>(),
            [false, true, false]
        );
    }

    #[test]
    fn write_after_read_and_write_after_write_get_barriers() {
        let plan = frame(
            2,
            &[("a", &[], &[0]), ("b", &[0], &[1]), ("c", &[], &[0]), ("d", &[], &[0])],
            &[0, 1],
        );
        assert_eq!(
            plan.steps.iter().map(|step| step.barrier).collect::<Vec<_>>(),
            [false, true, true, true]
        );
    }

    #[test]
    fn an_unread_pass_is_dropped_and_takes_its_sources_with_it() {
        let plan = frame(3, &[("a", &[], &[0]), ("b", &[0], &[1]), ("c", &[], &[2])], &[2]);
        assert_eq!(plan.steps.len(), 1);
        assert_eq!(plan.memory, [None, None, Some(0)]);
    }

    #[test]
    fn memory_of_the_same_description_is_reused_after_its_last_use_with_a_barrier() {
        let plan = frame(
            4,
            &[("a", &[], &[0]), ("b", &[0], &[1]), ("c", &[1], &[2]), ("d", &[2], &[3])],
            &[3],
        );
        assert_eq!(plan.memory, [Some(0), Some(1), Some(0), Some(1)]);
        assert_eq!(plan.barriers(), 3);
    }

    #[test]
    fn what_a_pass_binds_twice_is_reused_once() {
        let plan = frame(
            4,
            &[("a", &[], &[0]), ("b", &[0, 0], &[1]), ("c", &[1], &[2]), ("d", &[1, 2], &[3])],
            &[3],
        );
        assert_eq!(plan.memory, [Some(0), Some(1), Some(0), Some(2)]);
    }

    #[test]
    fn a_pass_of_its_own_pixels_writes_over_what_it_reads_for_the_last_time() {
        let plan =
            frame(4, &[("a", &[], &[0, 1]), ("own b", &[0, 1], &[2]), ("c", &[1, 2], &[3])], &[3]);
        assert_eq!(plan.memory, [Some(0), Some(1), Some(0), Some(2)]);
        assert_eq!(
            plan.steps.iter().map(|step| step.barrier).collect::<Vec<_>>(),
            [false, true, true]
        );
    }

    /// Plans buffers of these sizes `[bytes]`, used by the passes `from..=to`.
    fn buffers(lifetimes: &[(u64, usize, usize)]) -> Plan {
        let resources: Vec<_> = (lifetimes.iter().enumerate())
            .map(|(i, &(bytes, ..))| Resource {
                name: format!("r{i}"),
                shape: Shape::Buffer(BufferDesc { bytes, place: Place::Device }),
                requirements: Some(MemoryRequirements {
                    bytes: bytes.next_multiple_of(64),
                    ..NEEDS
                }),
            })
            .collect();
        let end = lifetimes.iter().map(|life| life.2).max().unwrap_or(0);
        let uses = |pass| {
            let used = (lifetimes.iter().enumerate())
                .filter(move |(_, (_, from, to))| (*from..=*to).contains(&pass));
            used.map(|(i, &(_, from, _))| {
                (ResourceId(i), if from == pass { Access::Write } else { Access::Modify })
            })
            .collect()
        };
        let passes: Vec<_> = (0..=end)
            .map(|pass| Pass { name: format!("p{pass}"), uses: uses(pass), in_place: false })
            .collect();
        // The last pass keeps the others, since it modifies what they modify.
        let wanted: Vec<_> =
            (0..lifetimes.len()).filter(|&i| lifetimes[i].2 == end).map(ResourceId).collect();
        plan(&passes, &resources, &wanted, 1 << 20)
    }

    fn bytes_of(plan: &Plan, resource: usize) -> Option<(usize, Range<u64>)> {
        plan.memories[plan.memory[resource]?].within.clone()
    }

    #[test]
    fn small_ones_lie_where_a_large_one_lay_behind_a_barrier() {
        let plan = buffers(&[(1024, 0, 1), (64, 1, 3), (512, 2, 3), (500, 2, 3)]);
        let at = |resource| bytes_of(&plan, resource).unwrap().1;
        assert_eq!([at(0), at(1), at(2), at(3)], [0..1024, 1024..1088, 0..512, 512..1024]);
        assert_eq!(plan.blocks, [MemoryRequirements { bytes: 1088, ..NEEDS }]);
        assert!(plan.steps[2].barrier);
    }

    #[test]
    fn what_one_allocation_cannot_hold_goes_to_another_block() {
        let plan = buffers(&[(700 << 10, 0, 1), (600 << 10, 0, 1), (300 << 10, 0, 1)]);
        assert_eq!([0, 1, 2].map(|i| bytes_of(&plan, i).unwrap().0), [0, 1, 0]);
        assert_eq!(plan.blocks.len(), 2);
    }

    #[test]
    fn an_image_is_born_where_others_lay_and_not_where_it_takes_over() {
        let plan = frame(
            5,
            &[("a", &[], &[0, 1]), ("own b", &[0, 1], &[2]), ("c", &[2], &[3]), ("d", &[3], &[4])],
            &[4],
        );
        // 0 and 2 share a memory, which 4 uses again; nothing else ever lay there.
        assert_eq!(plan.memory, [Some(0), Some(1), Some(0), Some(1), Some(0)]);
        assert_eq!(
            plan.steps.iter().map(|step| step.discards.clone()).collect::<Vec<_>>(),
            [vec![0, 1], vec![], vec![], vec![]]
        );
    }

    proptest::proptest! {
        #[test]
        fn no_two_lie_in_the_same_bytes_at_the_same_time(lifetimes in proptest::collection::vec((1u64..5000, 0usize..12, 0usize..6), 1..40)) {
            let lifetimes: Vec<_> = lifetimes.into_iter().map(|(bytes, from, more)| (bytes, from, from + more)).collect();
            let plan = buffers(&lifetimes);
            for (i, a) in lifetimes.iter().enumerate() {
                for (j, _) in lifetimes.iter().enumerate().skip(i + 1).filter(|(_, b)| a.1 <= b.2 && b.1 <= a.2) {
                    if let (Some((of_a, a)), Some((of_b, b))) = (bytes_of(&plan, i), bytes_of(&plan, j)) {
                        proptest::prop_assert!(of_a != of_b || a.end <= b.start || b.end <= a.start, "{i} at {a:?}, {j} at {b:?}");
                    }
                }
            }
        }
    }

    #[test]
    #[should_panic(expected = "b reads r1, which nothing has written")]
    fn reading_what_nothing_has_written_panics_with_names() {
        frame(3, &[("a", &[], &[0]), ("b", &[1], &[2])], &[2]);
    }
}
