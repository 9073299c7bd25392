//! A picture of a cloud in a view. It is recorded when something changes, and shown again until
//! then.

use super::clouds::CloudId;
use super::compose::{self, Area, ColorTable, Descriptors};
use super::host::Target;
use super::projection::{Depth, Transform, ViewCamera};
use super::{EffectReport, FrameReport, FrameView, PickId};
use crate::error::Result;
use crate::graph::host::Answers;
use crate::graph::record::Recorded;
use crate::graph::{Buffer, Gpu, Graph, Handle};
use crate::passes::occluder::{self, HostDepth};
use crate::passes::picked::{self, Picked};
use crate::passes::{Effect, Switch};
use crate::render::frame;
use crate::render::settings::{FrameConfig, RenderSettings};
use crate::resident::{Resident, ResidentNode};
use crate::view::View;

/// What a picture depends on.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Key {
    pub cloud: CloudId,
    pub camera: ViewCamera,
    pub size: [u32; 2],
    /// True if it has a background of its own.
    pub opaque: bool,
    /// True if it has ids and normals.
    pub layers: bool,
    /// Counts changes of settings, filters and transforms.
    pub revision: u64,
}

impl Key {
    /// Tests whether the picture is that of a cloud in a view.
    pub fn shows(&self, cloud: CloudId, view: &FrameView, revision: u64) -> bool {
        (self.cloud, self.camera, self.size, self.revision)
            == (cloud, view.camera, view.area.size, revision)
    }
}

/// Picks in a recorded picture.
pub(super) struct RecordedPicks {
    /// Picks and their pixels.
    pub pixels: Vec<(PickId, [u32; 2])>,
    pub depth: Buffer,
    pub index: Buffer,
    /// Words of their points.
    pub points: Picked,
    pub transform: Transform,
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
    /// Descriptors of the draw into targets.
    pub descriptors: Descriptors,
    /// Descriptors of the draw of ids and normals.
    pub layers: Option<Descriptors>,
    pub points: u64,
    pub effects: Vec<EffectReport>,
    /// True if everything that the view calls for is in it.
    pub settled: bool,
    /// What the device was asked for this view and these points.
    answers: Answers,
    /// True if the picture changes with answers of the device.
    pub waits: bool,
    /// Copy of the host's depth that hides its layers, which another frame has another one of.
    occluder: Option<HostDepth>,
}

/// Strokes follow from the neighbours of points, which are sought while a cloud is loaded.
const NO_STROKES: &str =
    "a cloud that was opened before the style was strokes is drawn as points; open it again";

/// Directions and curvatures along which strokes are painted are those of the cloud as it is.
const NO_MAPPED_STROKES: &str = "a cloud whose transform is no similarity, or whose view is mirrored or has pixels that are not square, is drawn as points instead of strokes";

/// Returns why there are no strokes, though they are wanted.
fn lacks_strokes(
    settings: &RenderSettings,
    view: &View,
    resident: &Resident,
) -> Option<&'static str> {
    let wanted = settings.effects.strokes.switch == Switch::On;
    let as_it_is = resident.map().is_identity() && !view.is_distorted();
    match (resident.shown.strokes(), as_it_is) {
        (None, _) if wanted => Some(NO_STROKES),
        (_, false) if wanted => Some(NO_MAPPED_STROKES),
        _ => None,
    }
}

/// Returns the configuration of a picture. Points without strokes are drawn as points.
pub(super) fn config(settings: &RenderSettings, view: &View, resident: &Resident) -> FrameConfig {
    let Some(why) = lacks_strokes(settings, view, resident) else {
        return FrameConfig::new(settings, view, resident);
    };
    let mut without = settings.clone();
    without.effects.strokes.switch = Switch::Off;
    let mut config = FrameConfig::new(&without, view, resident);
    config.decisions.explain(Effect::Strokes, why);
    config
}

/// A picture to be drawn.
pub(super) struct Drawing<'d> {
    pub key: Key,
    pub frame: u64,
    pub view: View,
    pub form: Depth,
    pub transform: Transform,
    /// Picks and their pixels.
    pub picks: Vec<(PickId, [u32; 2])>,
    pub settings: &'d RenderSettings,
    /// True if everything that the view calls for is resident.
    pub settled: bool,
    /// Depth that hides layers by themselves, in its attachment layout, and the area of the view;
    /// `None` if nothing is there yet, or it cannot be copied.
    pub depth: Option<(&'d Target, Area)>,
    pub table: &'d ColorTable,
}

impl Drawing<'_> {
    /// Records the picture; `None` if `before` shows it already.
    pub fn record(
        self,
        gpu: &mut Gpu,
        resident: &Resident,
        before: Option<&RecordedPicture>,
        report: &mut FrameReport,
    ) -> Result<Option<RecordedPicture>> {
        let view = self.view;
        let before = before.filter(|before| {
            before.key == self.key && self.picks.is_empty() && before.occluder.is_none()
        });
        if before.is_some_and(|before| before.settled) {
            return Ok(None);
        }
        let settled = self.settled;
        let identity = resident.identity();
        // The same points make another picture only with answers of the device.
        let same = before.filter(|before| before.identity == identity);
        let completed = gpu.completed()?;
        if same.is_some_and(|same| if same.waits { same.frame > completed } else { !settled }) {
            return Ok(None);
        }
        report.errors.extend(lacks_strokes(self.settings, &view, resident).map(String::from));
        let mut answers = same.map(|same| same.answers.clone()).unwrap_or_default();
        let light = self.transform.light(self.settings.light);
        let settings = RenderSettings { light, ..self.settings.clone() };
        let mut config = config(&settings, &view, resident);
        if !self.key.opaque {
            // Blended over what is there.
            config.background = [0.0; 3];
        }
        let hides = self.depth.filter(|_| config.layers() > 1);
        let host = |(depth, area): (&Target, Area)| {
            let form = [self.form.a as f32, self.form.b as f32];
            let (bits, far) = (depth.depth_bits(), self.form.far());
            let copy = compose::copy_depth(gpu, gpu.host_commands(), depth, area)?;
            Ok::<_, crate::error::Error>(HostDepth { copy, bits, form, far })
        };
        let host = hides.map(host).transpose()?;
        let mut g = Graph::new(gpu).with_answers(&mut answers);
        let occluder = host.as_ref().map(|host| occluder::record(&mut g, &view, host));
        let outcome = frame::record_behind(&mut g, &view, resident, &config, occluder)?;
        let (depth, index) = (&outcome.gbuffer.depth, &outcome.gbuffer.index);
        let picks = match self.picks.is_empty() {
            true => None,
            false => {
                let pixels: Vec<[u32; 2]> = self.picks.iter().map(|(_, pixel)| *pixel).collect();
                Some(RecordedPicks {
                    points: picked::record(&mut g, resident, index, &pixels)?,
                    pixels: self.picks,
                    depth: g.download(depth),
                    index: g.download(index),
                    transform: self.transform,
                    nodes: resident.nodes.clone(),
                })
            }
        };
        let images = [&outcome.picture, depth, index, &outcome.normal];
        let shown = if self.key.layers { &images[..] } else { &images[..2] };
        let wanted: Vec<_> = shown.iter().map(|image| image.resource()).collect();
        let recorded = g.record_for_host(&wanted)?;
        let [picture, depth] = [images[0], images[1]].map(|image| recorded.image(image));
        let descriptors = compose::of_colors(gpu, self.table, [picture, depth])?;
        let layers = match shown {
            [_, _, index, normal] => {
                let [index, normal] = [index, normal].map(|image| recorded.image(image));
                Some(compose::of_layers(gpu, [index, normal, depth])?)
            }
            _ => None,
        };
        let waits = outcome.strokes.as_ref().is_some_and(|painted| painted.waits);
        let effect = |(effect, reason): &(Effect, crate::passes::Reason)| EffectReport {
            name: effect.name(),
            runs: reason.runs,
            why: reason.why.clone(),
        };
        Ok(Some(RecordedPicture {
            key: self.key,
            frame: self.frame,
            view,
            form: self.form,
            identity,
            recorded,
            picks,
            descriptors,
            layers,
            points: outcome.statistics.points_drawn,
            effects: config.decisions.0.iter().map(effect).collect(),
            settled: settled && !waits,
            answers,
            waits,
            occluder: host,
        }))
    }
}
