//! Jobs of a plan, each into a part; and merging their parts into an index.

use super::build_chunk::{OpenNode, TreeSpec};
use super::builder::{Builder, Survey};
use super::ingest::cells_of;
use super::kd_cell::KdCell;
use super::part_file::{self, PartFile, WrittenCell};
use super::plan::{Plan, PlannedJob, PlannedTree, changed};
use super::point_record::Batch;
use super::spill_bucket::{Grid, Spill};
use super::{Options, Placing, Summary};
use crate::error::{Error, Result};
use crate::index::format::samples::Cell;
use crate::index::format::{Writer, morton};
use crate::progress::Progress;
use std::mem::take;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// A summary of a job.
#[derive(Clone, Copy, Debug, serde::Serialize)]
pub struct JobSummary {
    pub points: u64,
    pub nodes: usize,
    pub bytes: u64,
    pub seconds: f64,
}

/// Builds the nodes of one job, numbered from 1, into a part. Uses the memory and the threads of
/// the options.
pub fn job(
    plan: &Plan,
    number: usize,
    output: &Path,
    options: &Options,
    progress: &dyn Progress,
) -> Result<JobSummary> {
    let began = Instant::now();
    let (tree, job) = number.checked_sub(1).and_then(|k| plan.jobs().nth(k)).ok_or_else(|| {
        Error::Request(format!("there is no job {number}: the plan has {}", plan.jobs().count()))
    })?;
    plan.check_files()?;
    super::with_threads(&plan.options(options.memory, options.threads)?, |options| {
        let paths: Vec<PathBuf> = plan.files.iter().map(|file| file.path.clone()).collect();
        let (sources, _) = super::open(&paths, options, progress)?;
        if sources.len() != plan.contents.parts.len() {
            return Err(Error::Request(format!(
                "the files have {} parts, not {} as when they were planned; plan them again",
                sources.len(),
                plan.contents.parts.len()
            )));
        }
        let writer = Writer::create(output)?;
        let spill = Spill::new(output, options.bucket_bytes())?;
        let contents = plan.contents.clone();
        let mut survey = Survey::new(&sources, options, progress, &spill, contents);
        plan.adopt(&mut survey);
        let mut layout = tree.layout();
        layout.kind.gains = survey.gains.clone();
        let grids = survey.collect(plan, tree, job)?;
        let chunks = grids.into_iter().map(|grid| survey.cut(grid, layout.layout));
        let chunks = chunks.collect::<Result<Vec<_>>>()?;
        let mut builder = Builder::new(survey, &writer);
        let mut cells = Vec::new();
        for (&(cell, points), chunks) in job.cells.iter().zip(chunks) {
            let open = builder.grow(&layout, chunks, points, cell)?;
            cells.push(WrittenCell { nodes_end: builder.nodes.len(), end: builder.end, open });
        }
        let Builder { nodes, .. } = builder;
        let bytes = part_file::write(writer, (plan.hash.clone(), number), &nodes, &cells)?;
        let seconds = began.elapsed().as_secs_f64();
        Ok(JobSummary { points: job.points(), nodes: nodes.len(), bytes, seconds })
    })
}

impl Survey<'_> {
    /// Reads the points of a job into grids of buckets, one a cell.
    fn collect(&self, plan: &Plan, tree: &PlannedTree, job: &PlannedJob) -> Result<Vec<Grid>> {
        let (layout, bits) = (tree.layout(), tree.bits());
        let codes: Vec<_> = job.cells.iter().map(|(cell, _)| cell.codes(bits)).collect();
        // Returns the cell of a place.
        let number = |q: Cell| {
            let code = morton::code_96(q);
            let next = codes.partition_point(|codes| codes.start <= code);
            next.checked_sub(1).filter(|&cell| codes[cell].contains(&code))
        };
        let meets = |[low, high]: [Cell; 2]| {
            job.cells.iter().map(|(cell, _)| cell.bounds(bits)).any(|cell| {
                (0..3).all(|axis| low[axis] <= cell[1][axis] && cell[0][axis] <= high[axis])
            })
        };
        let taken = self.spill.taken();
        loop {
            let grid = |_| Grid::new(bits, layout.layout, self.options.chunk_points());
            let grids: Vec<Grid> = (0..codes.len()).map(grid).collect();
            let mut again = false;
            for member in tree.members.iter().filter(|member| member.bounds.is_some_and(meets)) {
                let source = &self.sources[member.part];
                let streamed = source.stream(self.progress, &|batch| {
                    let mut cells = Vec::new();
                    cells_of(batch.columns, member.shift, layout.kind.corner, &mut cells);
                    let mut kept = vec![Vec::new(); grids.len()];
                    for (i, &q) in (0..).zip(&cells) {
                        if let Some(cell) = number(q) {
                            kept[cell].push(i);
                        }
                    }
                    for (grid, kept) in grids.iter().zip(kept).filter(|(_, kept)| !kept.is_empty())
                    {
                        let columns = batch.columns.pick(&kept);
                        let cells: Vec<Cell> = kept.iter().map(|&i| cells[i as usize]).collect();
                        let part = member.part as u16;
                        let batch = Batch { cells: &cells, columns: &columns, part };
                        grid.add(&batch, &mut Default::default(), self.spill)?;
                    }
                    Ok(())
                })?;
                again |= streamed.again;
                let on_tree = streamed.bounds.map(|bounds| member.on_tree(bounds, &layout.kind));
                if streamed.points != plan.contents.parts[member.part].points
                    || on_tree != member.bounds
                {
                    return Err(changed(source.path()));
                }
            }
            if again {
                drop(grids);
                self.spill.forget(taken);
                continue;
            }
            if grids.iter().zip(&job.cells).any(|(grid, (_, points))| grid.points() != *points) {
                return Err(Error::Request(
                    "the files have changed since the index was planned; plan it again".into(),
                ));
            }
            return Ok(grids);
        }
    }
}

/// Merges the parts of all jobs, in their order, into an index: its bytes are those of one that is
/// built at once. Uses the memory and the threads of the options.
pub fn merge(
    plan: &Plan,
    parts: &[PathBuf],
    output: &Path,
    options: &Options,
    progress: &dyn Progress,
) -> Result<Summary> {
    let began = Instant::now();
    let count = plan.jobs().count();
    if parts.len() != count {
        return Err(Error::Request(format!("{} parts are not those of {count} jobs", parts.len())));
    }
    // Missing parts are reported before the work begins.
    let missing: Vec<&PathBuf> = parts.iter().filter(|path| !path.exists()).collect();
    if let Some(first) = missing.first() {
        return Err(Error::Request(format!(
            "{} of {count} parts are missing, the first is {}; run their jobs",
            missing.len(),
            first.display()
        )));
    }
    super::with_threads(&plan.options(options.memory, options.threads)?, |options| {
        let writer = Writer::create(output)?;
        let spill = Spill::new(output, 0)?;
        let contents = plan.contents.clone();
        let mut survey = Survey::new(&[], options, progress, &spill, contents);
        plan.adopt(&mut survey);
        let mut builder = Builder::new(survey, &writer);
        let mut first = 0;
        for tree in &plan.trees {
            let mut kind = tree.layout().kind;
            kind.gains = builder.survey.gains.clone();
            let end = first + tree.jobs.len();
            let open = builder.join(&kind, &plan.hash, first + 1, tree, &parts[first..end])?;
            builder.root(&open, tree.is_of_strays);
            first = end;
        }
        let summary = builder.complete()?.write(writer, options, progress)?;
        Ok(Summary { seconds: began.elapsed().as_secs_f64(), ..summary })
    })
}

impl Builder<'_> {
    /// Places the parts of a tree, the first of which is of job `first`, and makes the nodes above
    /// them.
    fn join(
        &mut self,
        kind: &TreeSpec,
        plan: &str,
        first: usize,
        tree: &PlannedTree,
        parts: &[PathBuf],
    ) -> Result<Vec<OpenNode>> {
        let nodes = take(&mut self.nodes);
        let mut state = Placing { end: self.end, nodes, ..Placing::default() };
        let mut planned = tree.cells().peekable();
        for (number, path) in (first..).zip(parts) {
            // One at a time: a survey may have more parts than a process may have open files.
            let part = PartFile::open(path)?;
            let cells = part.cells(plan, number)?;
            if cells.len() != tree.jobs[number - first].cells.len() {
                return Err(Error::Request(format!("the part of job {number} lacks cells")));
            }
            for mut cell in cells {
                let own = planned.next().expect("as many as the plan has");
                let (nodes, open) = (take(&mut cell.nodes), take(&mut cell.open));
                let placed = state.next;
                let at = state.place(own, nodes, open, cell.bytes);
                part.copy(&cell, |offset, bytes| self.writer.put(at + offset, bytes))?;
                state.written(placed);
                self.ascend(&mut state, kind, planned.peek(), KdCell::ALL)?;
            }
            let done = number - first + 1;
            self.survey.progress.tick("merging parts", done as u64, parts.len() as u64)?;
        }
        Ok(self.placed(state))
    }
}
