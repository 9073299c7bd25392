//! Streaming: the resident nodes of an index, and those that a frame draws.
//!
//! Every frame, [`Residency::update`] runs without waiting:
//!
//! - take the loader's answers; free pages that the GPU no longer reads
//! - choose the LOD cut for the view; while its pages do not fit the pool, one with half of the
//!   points
//! - request missing nodes: roots first, then by screen error, at most UPLOAD_BYTES at a time, or
//!   UPLOAD_BYTES_SHARED for a moving picture on a software device; if the pool is full, evict the
//!   least recently drawn nodes outside the cut
//! - draw each node of the cut; instead of a missing one its children, if all are resident, else
//!   its nearest resident ancestor alone; where nodes add to those above them, what is resident
//!
//! Roots stay resident, so that there is always an ancestor. A node that cannot be read is reported
//! once and left to its parent or children ([`lod::choose`]), and those of a server are tried again
//! later. So is one left that has not come in time, which is drawn once it comes. A loader that has
//! ended is replaced.
//!
//! Nodes that fit an empty pool may not fit among pages in unfavourable places. Once the views
//! rest and nothing else can come, all but the roots is evicted once, and comes again in the order
//! of requests.
//!
//! [`Residency::wait_until_resident`] repeats that until the cut is complete: the picture then
//! depends on view, detail and pool alone, not on earlier frames.
//!
//! Pages are reused when the device has completed the last submission that may read them
//! (`Gpu::completed`). So update between frames, not between recording and submitting one.

use super::pages::{PAGE_BYTES, Pages};
use super::pool::Pool;
use super::{Resident, ResidentNode, in_metres};
use crate::cloud::attribute::DisplayAttribute;
use crate::config::{UPLOAD_BYTES, UPLOAD_BYTES_SHARED};
use crate::error::{Error, Result};
use crate::gpu::memory::MappedRange;
use crate::gpu::timeline::Timeline;
use crate::graph::Gpu;
use crate::index::build::pack::Frame;
use crate::index::format::scatter::Clump;
use crate::index::format::{Index, Plane, Refinement};
use crate::loader::{Answer, Destination, Loader, NodeRequest, Outcome};
use crate::progress::Progress;
use crate::select::clip::{Clips, Left};
use crate::select::lod::{self, Cut, Detail};
use crate::select::opacity::Opacities;
use crate::view::View;
use crate::view::linear_map::LinearMap;
use std::collections::{BTreeSet, HashMap, HashSet, VecDeque};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::{Duration, Instant};

/// Time after which a node that a server did not give is asked for again.
const AGAIN: Duration = Duration::from_secs(10);

/// Pages of a node: position planes, then the attribute words of its points.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Run {
    first_page: u32,
    planes: u32,
    pages: u32,
}

/// A node that has pages, or is being loaded.
#[derive(Clone, Debug, Default)]
struct Entry {
    here: Option<Run>,
    /// Point spacing [cells of the coarsest plane].
    spacing: f64,
    /// How its points lie.
    clumps: Arc<[Clump]>,
    /// Pages that the loader is writing.
    coming: Option<Run>,
    /// Last update that drew it.
    drawn: u64,
    /// Last submission that may have read its pages.
    read_by: u64,
}

/// Coarser nodes that are requested besides the cut: the missing ancestors of missing nodes, so
/// that a missing node does not coarsen all of a root, and the roots.
#[derive(Clone, Copy, PartialEq)]
enum Fallback {
    None,
    Roots,
    Ancestors,
}

/// A cut that fits an empty pool, but not among the pages that are taken.
struct Stuck {
    /// The views for which it was chosen.
    views: Vec<View>,
    /// Last submission when that was first seen.
    since: u64,
    /// True if the pool was packed for it.
    is_packed: bool,
}

/// Request policy of a step.
#[derive(Clone, Copy)]
struct RequestPolicy {
    /// True if coarser nodes are requested as well, until the cut is resident.
    fall_back: bool,
    /// Most bytes of pages being loaded, unless one node needs more.
    max_in_flight: u64,
}

/// A node requested by an update.
#[derive(Clone, Copy, Debug)]
struct WantedNode {
    node: usize,
    planes: u32,
    /// True if it is in the cut, not only a fallback.
    needed: bool,
}

/// Outcome of an update.
#[derive(Clone, Debug, Default)]
pub struct Update {
    pub cut: Cut,
    /// Point budget of the cut; less than requested if the pool is too small.
    pub budget: u64,
    /// Nodes of the cut that are not resident.
    pub missing: usize,
    /// Nodes of the cut that are resident with fewer planes than the view wants.
    pub coarse: usize,
    /// Missing nodes without a resident substitute.
    pub holes: usize,
    pub evicted: usize,
    /// Bytes read from the file since the last update.
    pub bytes_read: u64,
    /// Unreadable nodes, each once, and memory that the device refused.
    pub errors: Vec<String>,
    /// Errors of earlier updates that no longer hold: nodes that had not come in time, and came.
    pub resolved: Vec<String>,
}

impl Update {
    pub fn is_complete(&self) -> bool {
        self.missing == 0 && self.coarse == 0
    }
}

/// The nodes of an index on the device, and their loader.
pub struct Residency {
    // Dropped in this order: the loader writes to the memory.
    loader: Loader,
    resident: Resident,
    index: Arc<Index>,
    /// Most pages, of which the device may refuse some.
    budget: u32,
    /// Answers published, and number of those taken.
    published: Arc<Published>,
    received: u64,
    /// Node last reported as stalled, with its error.
    stalled: Option<(usize, String)>,
    entries: HashMap<usize, Entry>,
    unreadable: HashSet<usize>,
    /// Those of a server, which are tried again at these times.
    again: VecDeque<(Instant, usize)>,
    /// Pages that a submission may still read.
    retired: Vec<(Run, u64)>,
    /// Set if a node has no room and none is coming.
    stuck: Option<Stuck>,
    /// Node numbers of `resident.nodes`.
    drawn: Vec<usize>,
    pages_coming: u32,
    updates: u64,
    /// Bytes read since the start.
    pub bytes_read: u64,
    pub evictions: u64,
    unreported: Update,
}

/// Returns how many pages an index may have. Point ids limit its nodes, and a node has two pages or
/// more.
fn pages_of(pool_bytes: u64) -> u32 {
    (pool_bytes / PAGE_BYTES).min(2 * super::MOST_NODES) as u32
}

/// Counter of the loader's answers.
struct Published {
    count: AtomicU64,
    timeline: Timeline,
}

impl Published {
    fn loader(
        self: &Arc<Published>,
        index: &Arc<Index>,
        shown: DisplayAttribute,
    ) -> Result<Loader> {
        let published = self.clone();
        let publish = move || {
            // The frame reports a lost device.
            let _ = published.timeline.signal(published.count.fetch_add(1, Relaxed) + 1);
        };
        Loader::start(index.clone(), shown, publish)
    }
}

struct Mapped(MappedRange);

impl Destination for Mapped {
    fn put(&mut self, page: u32, words: &[u32]) {
        self.0.write((PAGE_BYTES * page as u64) as usize, bytemuck::cast_slice(words));
    }
}

impl Drop for Residency {
    /// Ends the timeline, to which a hanging thread may hold on.
    fn drop(&mut self) {
        self.published.timeline.end();
    }
}

impl Residency {
    /// Opens an index with at most `pool_bytes` of device memory.
    pub fn open(
        gpu: &mut Gpu,
        index: Arc<Index>,
        shown: DisplayAttribute,
        pool_bytes: u64,
    ) -> Result<Residency> {
        let timeline = Timeline::new(&gpu.device, &gpu.memory.alive, "loaded")?;
        let published = Arc::new(Published { count: AtomicU64::new(0), timeline });
        let loader = published.loader(&index, shown)?;
        let budget = pages_of(pool_bytes);
        gpu.residents += 1;
        let resident = Resident {
            serial: gpu.residents,
            pool: Pool::new(gpu, budget),
            nodes: Vec::new(),
            shown,
            points: index.directory.contents.points,
            stations: index.directory.contents.stations.clone(),
            spacing_m: None,
            counts: index.directory.contents.counts.clone(),
            balance: index
                .directory
                .contents
                .balance_of(shown.attribute)
                .filter(|_| shown.coded)
                .cloned(),
            oriented: shown.further.normal
                && (index.directory.contents.oriented || !index.has(Plane::Facing)),
            axes: index.directory.contents.axes,
            filtered: index.filter.is_some(),
            opacities: Opacities::default(),
            comes_and_goes: true,
            light: index
                .shadows
                .as_ref()
                .filter(|_| shown.light().is_some())
                .map(|shadows| Box::new(shadows.contents.clone())),
            clips: Clips::default(),
            map: LinearMap::default(),
            unit: index.reference().unit(),
        };
        Ok(Residency {
            resident,
            index,
            loader,
            budget,
            published,
            received: 0,
            stalled: None,
            entries: HashMap::new(),
            unreadable: HashSet::new(),
            again: VecDeque::new(),
            retired: Vec::new(),
            stuck: None,
            drawn: Vec::new(),
            pages_coming: 0,
            updates: 0,
            bytes_read: 0,
            evictions: 0,
            unreported: Update::default(),
        })
    }

    /// Returns what the last update draws.
    pub fn resident(&self) -> &Resident {
        &self.resident
    }

    pub fn resident_mut(&mut self) -> &mut Resident {
        &mut self.resident
    }

    pub fn index(&self) -> &Index {
        &self.index
    }

    /// Returns the nodes that the last update draws.
    pub fn drawn(&self) -> &[usize] {
        &self.drawn
    }

    pub fn is_resident(&self, node: usize) -> bool {
        self.here(node).is_some()
    }

    /// Returns size and used part of the pool `[bytes]`.
    pub fn pool_bytes(&self) -> [u64; 2] {
        [self.resident.pool.pages.budget, self.resident.pool.pages.used]
            .map(|pages| PAGE_BYTES * pages as u64)
    }

    /// Sets the most bytes of device memory. Nodes in pages beyond are evicted, and that memory is
    /// freed once the device has completed what reads it. Returns whether the next update may draw
    /// other nodes; nothing is drawn until then if any were evicted.
    pub fn set_pool_bytes(&mut self, gpu: &Gpu, bytes: u64) -> Result<bool> {
        let budget = pages_of(bytes);
        let changes = std::mem::replace(&mut self.budget, budget) != budget;
        if changes {
            self.stuck = None;
            self.resident.pool.set_budget(budget);
        }
        let budget = self.resident.pool.pages.budget;
        let before = self.evictions;
        if !self.resident.pool.pages.is_free_from(budget) {
            self.note_readers(gpu);
            self.evict(gpu, |_, run| run.first_page + run.pages > budget)?;
        }
        self.resident.pool.free_unused();
        Ok(changes || self.evictions > before)
    }

    /// Returns the processor time of the loader ([`Loader::worked`]).
    pub fn loader_worked(&self) -> Duration {
        self.loader.worked()
    }

    /// Updates what the next frame draws. Never waits.
    pub fn update(&mut self, gpu: &mut Gpu, view: &View, detail: &Detail) -> Result<Update> {
        self.update_views(gpu, std::slice::from_ref(view), detail, UPLOAD_BYTES)
    }

    /// Updates what the next frame draws of several views, which share one cut. At most
    /// `max_in_flight` bytes are loaded at a time, unless one node is larger.
    pub fn update_views(
        &mut self,
        gpu: &mut Gpu,
        views: &[View],
        detail: &Detail,
        max_in_flight: u64,
    ) -> Result<Update> {
        self.step(gpu, views, detail, RequestPolicy { fall_back: true, max_in_flight })
    }

    /// Updates for a moving picture with even frame times: on a software device, whose cores the
    /// loader shares, it requests less at a time.
    pub fn update_moving(&mut self, gpu: &mut Gpu, view: &View, detail: &Detail) -> Result<Update> {
        let max_in_flight = if gpu.device.is_cpu { UPLOAD_BYTES_SHARED } else { UPLOAD_BYTES };
        let views = std::slice::from_ref(view);
        self.step(gpu, views, detail, RequestPolicy { fall_back: true, max_in_flight })
    }

    /// Waits until the cut is complete. Unreadable nodes are left out and reported in the outcome's
    /// errors.
    pub fn wait_until_resident(
        &mut self,
        gpu: &mut Gpu,
        view: &View,
        detail: &Detail,
        progress: &dyn Progress,
    ) -> Result<Update> {
        let mut whole = Update::default();
        let mut stuck = 0;
        loop {
            let update = self.step(
                gpu,
                std::slice::from_ref(view),
                detail,
                RequestPolicy { fall_back: false, max_in_flight: UPLOAD_BYTES },
            )?;
            let is_new = |said: &&String| !whole.errors.contains(said);
            let new: Vec<String> = update.errors.iter().filter(is_new).cloned().collect();
            whole.errors.extend(new);
            whole.bytes_read += update.bytes_read;
            whole.evicted += update.evicted;
            let total = update.cut.nodes.len() as u64;
            progress.tick("loading", total - (update.missing + update.coarse) as u64, total)?;
            if update.is_complete() {
                return Ok(Update {
                    errors: whole.errors,
                    bytes_read: whole.bytes_read,
                    evicted: whole.evicted,
                    ..update
                });
            }
            if self.pages_coming == 0 && self.resident.pool.has_pending_copies() {
                gpu.wait_detached()?;
                continue;
            }
            if self.pages_coming > 0 {
                // The next step notices a thread that has ended.
                if let Ok(Some(answer)) = self.loader.wait(Duration::from_millis(100)) {
                    self.receive(answer);
                    stuck = 0;
                }
                continue;
            }
            // The cut fits an empty pool: pages in unfavourable places are in the way.
            stuck += 1;
            if stuck > 1 {
                let [pool, _] = self.pool_bytes();
                return Err(Error::Request(format!(
                    "{} MiB of GPU memory do not hold the roots of this index; give more",
                    pool >> 20
                )));
            }
            self.evict(gpu, |_, _| true)?;
        }
    }

    fn step(
        &mut self,
        gpu: &mut Gpu,
        views: &[View],
        detail: &Detail,
        policy: RequestPolicy,
    ) -> Result<Update> {
        self.updates += 1;
        self.note_readers(gpu);
        self.receive_answers()?;
        self.resident.pool.submit_copies(gpu)?;
        self.reclaim(gpu)?;
        // A picture that waits is drawn of what comes at the first try.
        while let Some((at, node)) = self.again.front().copied()
            && at <= Instant::now()
            && policy.fall_back
        {
            self.again.pop_front();
            self.unreadable.remove(&node);
        }
        let (cut, budget) = self.fitting(views, detail, policy.fall_back);
        let mut update = Update { cut, budget, ..std::mem::take(&mut self.unreported) };
        self.stuck.take_if(|stuck| stuck.views != views);
        let is_packed = self.stuck.as_ref().is_some_and(|stuck| stuck.is_packed);
        let fall_back = match policy.fall_back {
            true if is_packed => Fallback::Roots,
            true => Fallback::Ancestors,
            false => Fallback::None,
        };
        let wants = self.wants(views, detail, &update.cut, fall_back);
        self.request(gpu, &wants, policy.max_in_flight, &mut update)?;
        for want in wants.iter().filter(|want| want.needed) {
            match self.here(want.node) {
                None => update.missing += 1,
                Some(run) => update.coarse += (run.planes < want.planes) as usize,
            }
        }
        if update.is_complete() {
            self.stuck = None;
        } else if policy.fall_back && !is_packed {
            self.pack_if_stuck(gpu, views)?;
        }
        update.holes = self.draw(views, &update.cut);
        Ok(update)
    }

    /// Notes that the last submission may read what is drawn.
    fn note_readers(&mut self, gpu: &Gpu) {
        for node in &self.drawn {
            self.entries.get_mut(node).expect("what is drawn is resident").read_by =
                gpu.last_reader();
        }
    }

    /// Evicts all but the roots if none of the missing nodes can come and the views rest: in a
    /// moving picture that would be seen, and others are called for soon.
    fn pack_if_stuck(&mut self, gpu: &Gpu, views: &[View]) -> Result<()> {
        let is_stuck = self.pages_coming == 0
            && self.retired.is_empty()
            && !self.resident.pool.has_pending_copies();
        if !is_stuck {
            self.stuck = None;
            return Ok(());
        }
        let Some(stuck) = &mut self.stuck else {
            let (since, views) = (gpu.last_reader(), views.to_vec());
            self.stuck = Some(Stuck { views, since, is_packed: false });
            return Ok(());
        };
        // Nodes that frames in flight read cannot be evicted yet.
        if gpu.completed()? < stuck.since {
            return Ok(());
        }
        stuck.is_packed = true;
        // Roots are the first that come.
        let roots = self.index.directory.roots as usize;
        let pages_of = |root| self.here(root).map_or(0, |run| run.pages);
        let root_pages: u32 = (0..roots).map(pages_of).sum();
        self.evict(gpu, |node, run| node >= roots || run.first_page + run.pages > root_pages)
    }

    fn here(&self, node: usize) -> Option<Run> {
        self.entries.get(&node).and_then(|entry| entry.here)
    }

    /// Returns the ancestors of a node, nearest first.
    fn ancestors(&self, node: usize) -> impl Iterator<Item = usize> + '_ {
        let above = |&node: &usize| {
            Some(self.index.nodes()[node].parent as usize).filter(|&parent| parent != node)
        };
        std::iter::successors(above(&node), above)
    }

    fn is_root(&self, node: usize) -> bool {
        node < self.index.directory.roots as usize
    }

    fn receive_answers(&mut self) -> Result<()> {
        let published = self.published.timeline.value()?;
        while self.received < published || self.loader.has_ended() {
            match self.loader.answer() {
                Ok(Some(answer)) => self.receive(answer),
                Ok(None) => break,
                Err(ended) => {
                    self.unreported.errors.push(ended.to_string());
                    return self.restart_loader();
                }
            }
        }
        let stalled = self.loader.stalled();
        if stalled != self.stalled.as_ref().map(|&(node, _)| node) {
            self.unreported.resolved.extend(self.stalled.take().map(|(_, error)| error));
            self.stalled = stalled.map(|node| {
                let (path, waited) =
                    (self.index.path().display(), self.loader.patience().as_secs_f64());
                (node, format!("{path}: node {node} has not come within {waited} s; coarser nodes are drawn until it does"))
            });
            self.unreported.errors.extend(self.stalled.iter().map(|(_, error)| error.clone()));
        }
        Ok(())
    }

    /// Replaces a loader that has ended, and drops what it was loading.
    fn restart_loader(&mut self) -> Result<()> {
        for run in self.entries.values_mut().filter_map(|entry| entry.coming.take()) {
            self.resident.pool.close(run.first_page, false);
            self.retired.push((run, 0));
        }
        self.pages_coming = 0;
        self.loader = self.published.loader(&self.index, self.resident.shown)?;
        self.received = self.published.timeline.value()?;
        Ok(())
    }

    fn receive(&mut self, Answer { node, outcome }: Answer) {
        self.received += 1;
        let entry = self.entries.get_mut(&node).expect("what is with the loader has an entry");
        let run = entry.coming.take().expect("an answer for every destination");
        self.pages_coming -= run.pages;
        self.resident.pool.close(run.first_page, matches!(outcome, Outcome::Done(_)));
        match outcome {
            Outcome::Done(read) => {
                let before = entry.here.replace(run);
                entry.spacing = read.spacing;
                entry.clumps = read.clumps.into();
                let read_by = entry.read_by;
                self.retired.extend(before.map(|before| (before, read_by)));
                self.bytes_read += read.bytes;
                self.unreported.bytes_read += read.bytes;
            }
            Outcome::Dropped => self.retired.push((run, 0)),
            Outcome::Failed(error) => {
                self.retired.push((run, 0));
                if self.index.is_remote() {
                    self.again.push_back((Instant::now() + AGAIN, node));
                }
                let said = format!("{error}; its nearest resident ancestor is drawn instead");
                // A server fails for many nodes in the same words.
                if self.unreadable.insert(node) && !self.unreported.errors.contains(&said) {
                    self.unreported.errors.push(said);
                }
            }
        }
    }

    /// Frees pages that no submission reads any more.
    fn reclaim(&mut self, gpu: &Gpu) -> Result<()> {
        if !self.retired.is_empty() {
            let passed = gpu.completed()?;
            let pages = &mut self.resident.pool.pages;
            self.retired.retain(|(run, read_by)| {
                let free = *read_by <= passed;
                if free {
                    pages.give(run.first_page, run.pages);
                }
                !free
            });
        }
        self.entries.retain(|_, entry| entry.here.is_some() || entry.coming.is_some());
        Ok(())
    }

    /// Returns the cut, its points halved until an empty pool holds its pages, and the point
    /// budget.
    fn fitting(&self, views: &[View], detail: &Detail, fall_back: bool) -> (Cut, u64) {
        let mut detail = *detail;
        loop {
            let cut = lod::choose_through(
                &self.resident.map,
                &self.index,
                views,
                &self.resident.clips,
                &detail,
                &self.unreadable,
            );
            let mut pages = Pages::new(self.resident.pool.pages.budget);
            // Fallback nodes give way, except the roots.
            let fall_back = if fall_back { Fallback::Roots } else { Fallback::None };
            let wants = self.wants(views, &detail, &cut, fall_back);
            let stay = wants.iter().filter(|want| want.needed || self.is_root(want.node));
            if detail.budget == 0
                || stay
                    .into_iter()
                    .all(|want| pages.take(want.planes + self.resident.shown.words()).is_some())
            {
                return (cut, detail.budget);
            }
            detail.budget = detail.budget.min(cut.points) / 2;
        }
    }

    /// Lists the wanted nodes in order of requests.
    fn wants(
        &self,
        views: &[View],
        detail: &Detail,
        cut: &Cut,
        fall_back: Fallback,
    ) -> Vec<WantedNode> {
        let mut above = BTreeSet::new();
        if fall_back != Fallback::None {
            above.extend(
                (0..self.index.directory.roots as usize)
                    .filter(|root| !self.unreadable.contains(root)),
            );
        }
        if fall_back == Fallback::Ancestors {
            for wanted in cut.nodes.iter().filter(|wanted| self.here(wanted.node).is_none()) {
                let missing =
                    self.ancestors(wanted.node).take_while(|&node| self.here(node).is_none());
                above.extend(missing.filter(|node| !self.unreadable.contains(node)));
            }
        }
        for wanted in &cut.nodes {
            above.remove(&wanted.node);
        }
        let above = above.into_iter().map(|node| WantedNode { node, planes: 1, needed: false });
        let needed = cut.nodes.iter().map(|wanted| {
            let record = &self.index.nodes()[wanted.node];
            let frame = self.frame(wanted.node);
            // Clipping needs the full position.
            let (bounds, lattice) = (self.index.bounds(record), self.index.lattice(record));
            let map = &self.resident.map;
            let planes = |view: &View| {
                let distance = view.least_depth(map.bounds(bounds))?;
                Some(detail.precision.planes(view, map, &lattice, &frame, distance))
            };
            let planes = match self.resident.clips.left(bounds) {
                Left::Some => frame.planes,
                _ => views.iter().filter_map(planes).max().unwrap_or(frame.planes),
            };
            WantedNode { node: wanted.node, planes, needed: true }
        });
        above.chain(needed).collect()
    }

    fn frame(&self, node: usize) -> Frame {
        let record = &self.index.nodes()[node];
        Frame {
            origin: record.origin,
            bits: record.bits as u32,
            extent: record.extent,
            planes: record.position_planes(),
        }
    }

    /// Posts the newest request list, with pages for as much of it as may be loaded at a time.
    fn request(
        &mut self,
        gpu: &mut Gpu,
        wants: &[WantedNode],
        max_in_flight: u64,
        update: &mut Update,
    ) -> Result<()> {
        let protected: HashMap<usize, bool> =
            wants.iter().map(|want| (want.node, want.needed)).collect();
        let mut victims = None;
        let mut list = Vec::new();
        let mut enough = false;
        for want in wants {
            let (here, coming) = self
                .entries
                .get(&want.node)
                .map_or((None, None), |entry| (entry.here, entry.coming));
            if coming.is_some() {
                list.push(NodeRequest { node: want.node, planes: want.planes, destination: None });
                continue;
            }
            if here.is_some_and(|run| run.planes >= want.planes) {
                continue;
            }
            let pages = want.planes + self.resident.shown.words();
            // In order, as `fitting` assumes: nothing smaller is taken first.
            enough |= self.pages_coming > 0
                && (self.pages_coming + pages) as u64 * PAGE_BYTES > max_in_flight;
            if enough {
                continue;
            }
            let Some(first_page) =
                self.take(gpu, pages, want.needed, &protected, &mut victims, update)?
            else {
                continue;
            };
            if !self.resident.pool.open(gpu, first_page, pages)? {
                // Nothing smaller is taken first, as above.
                self.resident.pool.pages.give(first_page, pages);
                enough = true;
                continue;
            }
            let range = self.resident.pool.mapped_range(first_page, pages);
            let run = Run { first_page, planes: want.planes, pages };
            self.entries.entry(want.node).or_default().coming = Some(run);
            self.pages_coming += pages;
            list.push(NodeRequest {
                node: want.node,
                planes: want.planes,
                destination: Some(Box::new(Mapped(range))),
            });
        }
        if self.pages_coming > 0 {
            self.loader.post(list);
        }
        Ok(())
    }

    /// Takes a run of pages, evicting the least recently drawn nodes if needed. Fallbacks are
    /// evicted last, and only for needed nodes.
    fn take(
        &mut self,
        gpu: &mut Gpu,
        pages: u32,
        needed: bool,
        protected: &HashMap<usize, bool>,
        victims: &mut Option<Vec<(bool, u64, usize)>>,
        update: &mut Update,
    ) -> Result<Option<u32>> {
        loop {
            match self.resident.pool.take(gpu, pages) {
                Ok(Some(first)) => return Ok(Some(first)),
                Ok(None) => {}
                Err(error) if self.resident.pool.allocated() == 0 => return Err(error),
                Err(error) => {
                    // The device has less memory than the budget: the pool keeps what it got.
                    let pool = &mut self.resident.pool;
                    pool.pages.budget = pool.pages.budget.min(pool.allocated());
                    update.errors.push(format!(
                        "GPU memory for nodes is limited to {} MiB: {error}",
                        self.pool_bytes()[0] >> 20
                    ));
                }
            }
            let victims = victims.get_or_insert_with(|| {
                let passed = gpu.completed().unwrap_or(0);
                let free = |(&node, entry): (&usize, &Entry)| {
                    entry.here?;
                    let kept = protected.get(&node).copied();
                    let may_go =
                        kept != Some(true) && !self.is_root(node) && entry.read_by <= passed;
                    may_go.then_some((kept.is_some(), entry.drawn, node))
                };
                let mut victims: Vec<_> = self.entries.iter().filter_map(free).collect();
                // Sorted to be popped from the end.
                victims.sort_unstable_by(|a, b| b.cmp(a));
                victims
            });
            let Some((_, _, node)) = victims.pop_if(|(kept, _, _)| needed || !*kept) else {
                return Ok(None);
            };
            let run = self
                .entries
                .get_mut(&node)
                .and_then(|entry| entry.here.take())
                .expect("a victim is resident");
            self.resident.pool.pages.give(run.first_page, run.pages);
            self.evictions += 1;
            update.evicted += 1;
        }
    }

    /// Evicts resident nodes. Nothing is drawn until the next choice if there are any.
    fn evict(&mut self, gpu: &Gpu, goes: impl Fn(usize, &Run) -> bool) -> Result<()> {
        let before = self.evictions;
        for (&node, entry) in &mut self.entries {
            if let Some(run) = entry.here.take_if(|run| goes(node, run)) {
                self.retired.push((run, entry.read_by));
                self.evictions += 1;
            }
        }
        if self.evictions > before {
            self.drawn.clear();
            self.resident.nodes.clear();
        }
        self.reclaim(gpu)
    }

    /// Chooses what the frame draws; returns the number of holes.
    fn draw(&mut self, views: &[View], cut: &Cut) -> usize {
        let mut drawn = BTreeSet::new();
        let mut standing_in = HashSet::new();
        let mut holes = 0;
        for wanted in &cut.nodes {
            if let Some(nodes) = self.finer(views, wanted.node) {
                drawn.extend(nodes);
            } else if let Some(ancestor) =
                self.ancestors(wanted.node).find(|&node| self.here(node).is_some())
            {
                standing_in.insert(ancestor);
            } else {
                holes += 1;
            }
        }
        drawn.extend(&standing_in);
        if !standing_in.is_empty() && self.index.refinement == Refinement::Replaces {
            drawn.retain(|&node| !self.ancestors(node).any(|above| standing_in.contains(&above)));
        }
        self.drawn = drawn.into_iter().collect();
        for node in &self.drawn {
            self.entries.get_mut(node).expect("resident").drawn = self.updates;
        }
        let (spacings, map) = (self.spacings(), self.resident.map);
        let nodes = self.drawn.iter().enumerate().map(|(number, &node)| {
            let Run { first_page, planes, .. } = self.here(node).expect("resident");
            let record = &self.index.nodes()[node];
            let (lattice, frame) = (self.index.lattice(record), self.frame(node));
            let Entry { clumps, .. } = &self.entries[&node];
            let spacing = spacings[number];
            let station = record.single_station().map(u32::from);
            ResidentNode {
                lattice,
                frame,
                count: record.count,
                number: number as u32,
                first_page,
                planes,
                own_spacing: spacing,
                map,
                clumps: clumps.clone(),
                station,
            }
        });
        self.resident.nodes = nodes.collect();
        holes
    }

    /// Returns the point spacing of every drawn node `[m]`. Points among which those of nodes below
    /// are drawn are as dense as these.
    fn spacings(&self) -> Vec<f64> {
        let own = |node: &usize| {
            let lattice = self.index.lattice(&self.index.nodes()[*node]);
            in_metres(self.entries[node].spacing, &lattice, &self.frame(*node))
        };
        let mut spacings: Vec<f64> = self.drawn.iter().map(own).collect();
        // Nodes come behind those above them.
        for (number, &node) in self.drawn.iter().enumerate().rev() {
            let above = self.ancestors(node).find_map(|node| self.drawn.binary_search(&node).ok());
            if let Some(above) = above.filter(|_| spacings[number] > 0.0) {
                spacings[above] = spacings[above].min(spacings[number]);
            }
        }
        spacings
    }

    /// Returns the node itself, or resident descendants that together show all of it in view. Nodes
    /// that only add to it do not.
    fn finer(&self, views: &[View], node: usize) -> Option<Vec<usize>> {
        if self.index.refinement == Refinement::Adds {
            return self.here(node).map(|_| vec![node]);
        }
        let map = &self.resident.map;
        let mut found = Vec::new();
        let mut open = vec![node];
        while let Some(node) = open.pop() {
            let record = &self.index.nodes()[node];
            if self.here(node).is_some() {
                found.push(node);
            } else if record.is_leaf() {
                return None;
            } else {
                open.extend(record.children().filter(|&child| {
                    let bounds = self.index.bounds(&self.index.nodes()[child]);
                    views.iter().any(|view| view.least_depth(map.bounds(bounds)).is_some())
                        && self.resident.clips.left(bounds) != Left::Nothing
                }));
            }
        }
        Some(found)
    }
}
