//! Drawing of one frame.

use super::{
    FrameReport, FrameTimes, Inbox, Loading, Measured, Message, Moving, Redraw, RenderEvent,
    RenderLoop, SLOW,
};
use crate::app::pick_buffer::PickBuffer;
use crate::config;
use crate::error::{Error, Result};
use crate::graph::{Gpu, Graph, Handle};
use crate::passes::encode::{self, Screen};
use crate::passes::tile_stats::Warned;
use crate::passes::{Effect, Switch, shadows};
use crate::present::Present;
use crate::progress::Progress;
use crate::render::frame;
use crate::render::gpu_cloud::GpuCloud;
use crate::render::settings::FrameConfig;
use crate::resident::Resident;
use crate::resident::streaming::Update;
use crate::tune::Tuning;
use crate::tune::error::Pixels;
use crate::tune::governor::divided;
use crate::view::View;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::{Duration, Instant};

/// Interrupts work when a newer message has come. On a software device a whole picture takes long.
pub(super) struct Superseded<'t> {
    pub posted: &'t AtomicU64,
    pub handled: u64,
}

impl Progress for Superseded<'_> {
    fn tick(&self, _doing: &str, _done: u64, _total: u64) -> Result<()> {
        if self.posted.load(Relaxed) > self.handled { Err(Error::Interrupted) } else { Ok(()) }
    }
}

/// A moving frame, to be compared with the picture that the window settles on.
pub(super) struct Moved {
    pick_buffer: Arc<PickBuffer>,
    screen: Vec<u32>,
}

impl Moved {
    /// Returns the errors of a frame against another one of the same camera in the window's size;
    /// the same function tells those of `tune`.
    fn measure(&self, settled: &Moved, blue_first: bool) -> Measured {
        let pixels = |moved: &Moved| {
            let PickBuffer { view, depth, .. } = &*moved.pick_buffer;
            Pixels::of_screen(view.size, &moved.screen, blue_first, depth.clone())
        };
        let settled = pixels(settled);
        let own = pixels(self).enlarged(settled.size);
        let map = own.map(&settled);
        let errors = own.errors_of(&settled, &map);
        Measured { errors, size: settled.size, map: map.into_iter().map(|px| px as f32).collect() }
    }
}

/// Time between two panels while a frame is drawn, so that panels do not take all of it.
pub(super) const PANEL_EVERY: Duration = Duration::from_millis(25);

/// Longest time of casting samples of the light between two frames.
const REFINE_BUDGET: Duration = Duration::from_millis(100);

/// Adds samples of the light to the shadows until it is superseded. Each has a submission of its
/// own, so that samples stay if the frame is interrupted.
fn refine_shadows(
    gpu: &mut Gpu,
    view: &View,
    resident: &Resident,
    config: &FrameConfig,
    newer: &Superseded,
) -> Result<()> {
    let (scene, began) = (config.frame_context(view, resident), Instant::now());
    loop {
        let mut g = Graph::new(gpu);
        let visibility = match shadows::light_visibility(
            &mut g,
            &scene,
            resident,
            &config.effects,
            &config.decisions,
            Some(1),
        ) {
            Ok(visibility) => visibility,
            Err(error) => {
                // Drawing reports the same error.
                return if let Error::Request(_) = error { Ok(()) } else { Err(error) };
            }
        };
        let Some(shadows::LightVisibility { counts, saved: None, facts, .. }) = visibility else {
            return Ok(());
        };
        g.submit_and_wait(&[counts.resource()])?;
        if facts.cast == facts.samples
            || began.elapsed() >= REFINE_BUDGET
            || newer.tick("", 0, 0).is_err()
        {
            return Ok(());
        }
    }
}

impl Inbox {
    /// Shows the last frame under a panel that has come while another frame is drawn. Other
    /// messages wait until that is done.
    pub(super) fn show_panel(
        &mut self,
        gpu: &mut Gpu,
        present: &mut Present,
        show_due: &mut bool,
    ) -> Result<()> {
        while let Ok(message) = self.messages.try_recv() {
            let is_urgent = message.is_urgent();
            match message {
                Message::Panel { overlay, .. } => {
                    self.urgent_handled += is_urgent as u64;
                    present.set_overlay(gpu, *overlay)?;
                    *show_due = true;
                }
                other => self.waiting.push_back(other),
            }
        }
        if *show_due && !present.is_empty() && present.show(gpu)? {
            *show_due = false;
        }
        Ok(())
    }
}

impl RenderLoop {
    /// Shows the last frame under the new panel.
    pub(super) fn show_again(&mut self) -> Result<()> {
        self.schedule.show_due = false;
        let present = self.present.as_mut().expect("taken at the end");
        if !present.fit(&mut self.renderer.gpu, self.viewport.reported)?
            || !present.show(&self.renderer.gpu)?
        {
            self.schedule.change(Instant::now());
        }
        Ok(())
    }

    /// Draws a frame; returns false if there is nothing new to show.
    pub(super) fn draw(&mut self) -> Result<bool> {
        let present = self.present.as_mut().expect("taken at the end");
        let (mut times, fitting) = (FrameTimes::default(), Instant::now());
        if !present.fit(&mut self.renderer.gpu, self.viewport.reported)? {
            // A message comes when the window is uncovered.
            (self.schedule.redraw, self.schedule.show_due) = (Redraw::Nothing, false);
            return Ok(false);
        }
        let (Some(scene), Some(id)) = (&self.scene, self.cloud) else {
            self.schedule.redraw = Redraw::Nothing;
            return self.blank().map(|()| true);
        };
        self.renderer.set_scene(scene);
        self.saves.scene_replaced = false;
        times.fitting = fitting.elapsed();
        let moves = self.schedule.redraw == Redraw::Changed;
        let place = self.governor.place();
        let tuning = if moves { self.governor.steps()[place].tuning } else { Tuning::usual() };
        let divisor = tuning.divisor();
        let known = self.governor.has_measured();
        let expected_ms = known.then(|| self.governor.expected(place));
        let size = divided(present.size(), divisor);
        let (settings, lod) = tuning.applied(&scene.settings, scene.lod, size);
        let view = self.viewport.view_of(scene.camera, size)?;
        let (mut loading, taking_in) = (None, Instant::now());
        let (gpu, cloud) = self.renderer.cloud(id)?;
        if let GpuCloud::Parts(residency) = cloud {
            let detail = lod.of(size);
            let update = match self.schedule.redraw {
                Redraw::Changed => residency.update_moving(gpu, &view, &detail)?,
                _ => residency.update(gpu, &view, &detail)?,
            };
            let Update { cut, budget, missing, coarse, bytes_read, errors, resolved, .. } = update;
            loading = Some(Loading {
                fitting: (budget < detail.budget).then_some(budget),
                nodes: cut.nodes.len(),
                awaited: missing + coarse,
                largest_error_px: cut.largest_error_px,
                pool_bytes: residency.pool_bytes(),
                bytes_read,
                worked: Duration::ZERO,
            });
            errors
                .into_iter()
                .for_each(|error| (self.report)(RenderEvent::Failed(Error::Request(error))));
            resolved.into_iter().for_each(|error| (self.report)(RenderEvent::Resolved(error)));
        }
        let complete = loading.is_none_or(|loading| loading.awaited == 0);
        times.taking_in = taking_in.elapsed();
        let recording = Instant::now();
        let identity = cloud.resident().identity();
        if self.schedule.redraw == Redraw::NodesArriving
            && identity == self.last_drawn
            && !complete
            && !present.is_empty()
        {
            return Ok(false);
        }
        // A refinement of the same picture can be interrupted; another picture is finished.
        let interruptible = !moves;
        // Effects are decided for the full size: a smaller picture has more points per pixel, and
        // would call for others.
        let full = self.viewport.view_of(scene.camera, present.size())?;
        let mut config = self.renderer.config(id, &full)?;
        self.renderer.set_settings(settings);
        let tuned = self.renderer.config(id, &full)?;
        let (gpu, cloud) = self.renderer.cloud(id)?;
        let resident = cloud.resident();
        if scene.settings.effects.strokes.switch == Switch::On && resident.shown.strokes().is_none()
        {
            config.decisions.explain(Effect::Strokes, "strokes are still being computed");
        }
        let drawn = match moves {
            false => config.progressive(),
            true if divisor > 1 => tuned.interactive(divisor).for_view(&view, resident),
            true => tuned.interactive(1),
        };
        if interruptible {
            refine_shadows(gpu, &view, resident, &config, &self.inbox.superseded())?;
        }
        let mut g = Graph::new(gpu);
        let outcome = match frame::record(&mut g, &view, resident, &drawn) {
            Ok(outcome) => outcome,
            Err(error) => {
                return match error {
                    // A newer message has come; it is handled next.
                    Error::Interrupted => Ok(true),
                    // The request cannot be drawn; the last frame stays until another request.
                    Error::Request(_) => {
                        (self.report)(RenderEvent::Failed(error));
                        self.schedule.redraw = Redraw::Nothing;
                        let nothing_is_there = self.present.as_ref().is_some_and(Present::is_empty);
                        if nothing_is_there { self.blank().map(|()| true) } else { Ok(false) }
                    }
                    _ => Err(error),
                };
            }
        };
        let mut screen = Screen {
            words: g.import("screen", present.screen()),
            blue_first: present.blue_first(),
        };
        encode::record(&mut g, &outcome.picture, &mut screen)?;
        let warned = Warned::ask(&mut g, &drawn.effects, &outcome.gbuffer);
        let words = g.download_buffer(&screen.words);
        let [depth, index] =
            [&outcome.gbuffer.depth, &outcome.gbuffer.index].map(|layer| g.download(layer));
        times.recording = recording.elapsed();
        let (began, handled) = (Instant::now(), self.inbox.handled);
        let (inbox, schedule) = (&mut self.inbox, &mut self.schedule);
        let mut shown = Instant::now();
        let mut pause = |gpu: &mut Gpu| {
            if shown.elapsed() >= PANEL_EVERY {
                inbox.show_panel(gpu, present, &mut schedule.show_due)?;
                shown = Instant::now();
            }
            if interruptible { inbox.picture_superseded().tick("", 0, 0) } else { Ok(()) }
        };
        let outputs = [screen.words.resource()];
        // Frames that are soon done, whole.
        let running = match schedule.took > SLOW || interruptible {
            true => g.submit_pausing(&outputs, &mut pause),
            false => g.submit_async(&outputs),
        };
        let running = match running {
            Ok(running) => running,
            // A newer message has come; it is handled next.
            Err(Error::Interrupted) => return Ok(true),
            Err(error) => return Err(error),
        };
        (self.report)(RenderEvent::FrameStarted);
        let frame = running.finish(&mut self.renderer.gpu)?;
        let took = began.elapsed();
        let reading_back = Instant::now();
        present.set_picture_size(&mut self.renderer.gpu, size)?;
        let is_whole = divisor == 1 && lod == scene.lod;
        let pick_buffer = Arc::new(PickBuffer {
            view,
            depth: frame.read(&depth).to_vec(),
            index: frame.read(&index).to_vec(),
            is_exact: is_whole && drawn.effects == config.effects && complete,
        });
        let passes = frame.passes.clone();
        let unordered = outcome.strokes.as_ref().and_then(|painted| painted.unordered.as_ref());
        let ordered = unordered.is_none_or(|unordered| frame.read::<u32>(unordered)[0] == 0);
        let (_, cloud) = self.renderer.cloud(id)?;
        let mut notes = config.warnings(cloud.resident());
        notes.extend(
            warned
                .note(&frame)
                .into_iter()
                .chain(outcome.strokes.as_ref().and_then(|painted| painted.facts.note())),
        );
        self.schedule.took = took;
        self.last_drawn = identity;
        let lit = outcome
            .gbuffer
            .light_visibility
            .as_ref()
            .is_none_or(|visibility| visibility.facts.cast == visibility.facts.samples);
        let finest = is_whole && drawn.effects == config.effects && lit && ordered;
        let shown = Moved { pick_buffer: pick_buffer.clone(), screen: frame.read(&words).to_vec() };
        let mut moving = None;
        if moves {
            let ms = took.as_secs_f64() * 1e3;
            self.governor.after(place, took);
            let steps = self.governor.steps().iter().enumerate();
            let curve = steps.map(|(k, step)| [self.governor.expected(k), step.errors.px]);
            moving = Some(Moving { tuning, curve: curve.collect(), place, expected_ms, ms });
            self.moved = Some(shown);
        } else if finest
            && complete
            && let Some(moved) = self.moved.take()
            && moved.pick_buffer.view.camera == view.camera
        {
            let (report, blue_first) = (self.report.clone(), screen.blue_first);
            let errors = move || {
                report(RenderEvent::Measured(Arc::new(moved.measure(&shown, blue_first))));
            };
            drop(std::thread::Builder::new().name("errors".into()).spawn(errors));
        }
        self.schedule.redraw = match (finest, complete) {
            (true, true) => Redraw::Nothing,
            (true, false) => Redraw::NodesArriving,
            _ => Redraw::FullResolution,
        };
        self.schedule.show_due = false;
        self.schedule.count_due =
            cloud.resident().leaves_out().then(|| config.drops_back_faces(cloud.resident()));
        (times.drawing, times.reading_back) = (took, reading_back.elapsed());
        let showing = Instant::now();
        if !present.show(&self.renderer.gpu)? {
            self.schedule.redraw = Redraw::Changed;
        }
        times.showing = showing.elapsed();
        if let (Some(loading), (_, GpuCloud::Parts(residency))) =
            (&mut loading, self.renderer.cloud(id)?)
        {
            loading.worked = residency.loader_worked();
        }
        let (decisions, statistics, latency) =
            (config.decisions, outcome.statistics, self.schedule.asked.elapsed());
        let (whole, leaves_out) =
            (finest && complete && self.uploading.is_none(), self.schedule.count_due.is_some());
        (self.report)(RenderEvent::FrameDone(Box::new(FrameReport {
            pick_buffer,
            decisions,
            notes,
            statistics,
            leaves_out,
            passes,
            whole,
            loading,
            moving,
            times,
            latency,
            took,
            handled,
        })));
        Ok(true)
    }

    /// Shows the background without points.
    fn blank(&mut self) -> Result<()> {
        let present = self.present.as_mut().expect("taken at the end");
        let [red, green, blue] = self
            .scene
            .as_ref()
            .map_or(config::BACKGROUND, |scene| scene.settings.background)
            .map(u32::from);
        let word = if present.blue_first() {
            blue | green << 8 | red << 16
        } else {
            red | green << 8 | blue << 16
        };
        let mut g = Graph::new(&mut self.renderer.gpu);
        let mut screen = g.import("screen", present.screen());
        g.fill(&mut screen, word | 255 << 24);
        g.submit_and_wait(&[screen.resource()])?;
        present.set_picture_size(&mut self.renderer.gpu, present.size())?;
        self.schedule.show_due = false;
        if !present.show(&self.renderer.gpu)? {
            self.schedule.redraw = Redraw::Changed;
        }
        Ok(())
    }
}
