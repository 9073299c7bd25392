//! A picture of a cloud in a view. It is recorded when something changes, and shown again until
//! then.

use super::clouds::CloudId;
use super::compose::Descriptors;
use super::projection::{Depth, ViewCamera};
use super::{EffectReport, FrameReport, PickId, RendererOptions};
use crate::error::Result;
use crate::gpu::memory::RawImage;
use crate::graph::record::Recorded;
use crate::graph::{Buffer, Gpu, Graph, Handle};
use crate::passes::Switch;
use crate::render::frame;
use crate::render::settings::{FrameConfig, RenderSettings};
use crate::render::source::GpuCloud;
use crate::resident::ResidentNode;
use crate::select::lod::LodOptions;
use crate::view::View;
use glam::DMat4;

/// What a picture depends on.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Key {
    pub cloud: CloudId,
    pub camera: ViewCamera,
    pub size: [u32; 2],
    /// Whether it has a background of its own.
    pub opaque: bool,
    /// Counts changes of settings, filters and transforms.
    pub revision: u64,
}

/// Picks in a recorded picture.
pub(super) struct RecordedPicks {
    /// Picks and their pixels.
    pub pixels: Vec<(PickId, [u32; 2])>,
    pub depth: Buffer,
    pub index: Buffer,
    pub transform: DMat4,
    /// Nodes that ids refer to.
    pub nodes: Vec<ResidentNode>,
}

/// A recorded picture, with what it uses.
pub(super) struct RecordedPicture {
    pub key: Key,
    /// Frame that recorded it.
    pub frame: u64,
    pub view: View,
    pub form: Depth,
    /// Points that are drawn.
    identity: Vec<u64>,
    pub recorded: Recorded,
    pub picks: Option<RecordedPicks>,
    pub picture: RawImage,
    pub depth: RawImage,
    /// For the draw into targets; set by the first.
    pub descriptors: Option<Descriptors>,
    pub points: u64,
    pub effects: Vec<EffectReport>,
    /// Whether everything that the view calls for is in it.
    pub settled: bool,
}

/// Strokes are counted on the CPU while a frame is recorded, for which nothing may wait here.
const NO_STROKES: &str = "strokes are not drawn in a host's frames; points are drawn without them";

/// A picture to be drawn.
pub(super) struct Drawing<'d> {
    pub key: Key,
    pub frame: u64,
    pub view: View,
    pub form: Depth,
    pub transform: DMat4,
    /// Picks and their pixels.
    pub picks: Vec<(PickId, [u32; 2])>,
    pub settings: &'d RenderSettings,
    pub options: &'d RendererOptions,
}

impl Drawing<'_> {
    /// Records the picture; `None` if `before` shows it already.
    pub fn record(
        self,
        gpu: &mut Gpu,
        cloud: &mut GpuCloud,
        before: Option<&RecordedPicture>,
        report: &mut FrameReport,
    ) -> Result<Option<RecordedPicture>> {
        let view = self.view;
        let before = before.filter(|before| before.key == self.key && self.picks.is_empty());
        if before.is_some_and(|before| before.settled) {
            return Ok(None);
        }
        let mut settled = true;
        if let GpuCloud::Parts(residency) = cloud {
            let lod = LodOptions { budget: self.options.point_budget, lod_px: None };
            let update = residency.update(gpu, &view, &lod.of(view.size))?;
            report.missing += update.missing + update.coarse;
            report.errors.extend(update.errors);
            settled = update.missing + update.coarse == 0;
        }
        let resident = cloud.resident();
        let identity = resident.identity();
        if !settled && before.is_some_and(|before| before.identity == identity) {
            return Ok(None);
        }
        let mut settings = self.settings.clone();
        if std::mem::replace(&mut settings.effects.strokes.switch, Switch::Off) == Switch::On {
            report.errors.push(NO_STROKES.into());
        }
        let mut config = FrameConfig::new(&settings, &view, resident);
        if !self.key.opaque {
            // Blended over what is there.
            config.background = [0.0; 3];
        }
        let mut g = Graph::new(gpu);
        let outcome = frame::record(&mut g, &view, resident, &config)?;
        let picks = (!self.picks.is_empty()).then(|| RecordedPicks {
            pixels: self.picks,
            depth: g.download(&outcome.gbuffer.depth),
            index: g.download(&outcome.gbuffer.index),
            transform: self.transform,
            nodes: resident.nodes.clone(),
        });
        let images = [&outcome.picture, &outcome.gbuffer.depth];
        let recorded = g.record_for_host(&images.map(|image| image.resource()))?;
        let [picture, depth] = images.map(|image| recorded.image(image));
        let effect = |(effect, reason): &(crate::passes::Effect, crate::passes::Reason)| {
            EffectReport { name: effect.name(), runs: reason.runs, why: reason.why.clone() }
        };
        Ok(Some(RecordedPicture {
            key: self.key,
            frame: self.frame,
            view,
            form: self.form,
            identity,
            recorded,
            picks,
            picture,
            depth,
            descriptors: None,
            points: outcome.statistics.points_drawn,
            effects: config.decisions.0.iter().map(effect).collect(),
            settled,
        }))
    }
}
