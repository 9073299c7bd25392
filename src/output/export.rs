//! Export of a frame: picture and layers as PNG and EXR.

use crate::error::{Error, Result};
use crate::graph::{Buffer, CompletedSubmission, Graph, Pause};
use crate::output::image_io::{self, Samples};
use crate::output::overlay::Overlay;
use crate::output::tiled::{self, PictureRequest};
use crate::passes::encode::{self, Encoded};
use crate::progress::Progress;
use crate::render::frame::Outcome;
use crate::renderer::{CloudId, Renderer};
use std::path::Path;

/// The images to download.
pub struct Downloads {
    picture: Option<Encoded>,
    linear: Option<Buffer>,
    depth: Option<Buffer>,
    index: Option<Buffer>,
    projected_depth: Option<Buffer>,
    projected_index: Option<Buffer>,
    normal: Option<Buffer>,
    /// Shading; `None` if no effect darkens.
    shading: Option<Buffer>,
}

impl Downloads {
    pub fn ask(g: &mut Graph, outcome: &Outcome, picture: bool, layers: bool) -> Result<Downloads> {
        let picture = picture.then(|| encode::download(g, &outcome.picture)).transpose()?;
        let linear = layers.then(|| g.download(&outcome.picture));
        let depth = layers.then(|| g.download(&outcome.gbuffer.depth));
        let index = layers.then(|| g.download(&outcome.gbuffer.index));
        let projected_depth = layers.then(|| g.download(&outcome.gbuffer.projected_depth));
        let projected_index = layers.then(|| g.download(&outcome.gbuffer.projected_index));
        let normal = layers.then(|| g.download(&outcome.normal));
        let shading =
            outcome.gbuffer.shading.as_ref().filter(|_| layers).map(|shading| g.download(shading));
        Ok(Downloads {
            picture,
            linear,
            depth,
            index,
            projected_depth,
            projected_index,
            normal,
            shading,
        })
    }

    /// Returns the pixels of the picture, RGB: rows from the top left.
    pub fn pixels(&self, frame: &CompletedSubmission) -> Vec<u8> {
        self.picture.as_ref().expect("asked for with -o").read(frame).concat()
    }

    /// Writes the requested files.
    pub fn write(
        &self,
        frame: &CompletedSubmission,
        size: [u32; 2],
        png: Option<&Path>,
        exr: Option<&Path>,
        over: Overlay,
    ) -> Result<()> {
        if let Some(path) = png {
            let picture = self.picture.as_ref().expect("asked for with -o");
            image_io::write_annotated_png(path, size, &picture.read(frame), over)?;
        }
        exr.map_or(Ok(()), |path| write_layers(path, size, frame, self))
    }
}

/// Draws a frame and writes its layers to a file, in one piece. Returns warnings.
pub fn write(
    renderer: &mut Renderer,
    cloud: CloudId,
    request: &PictureRequest,
    path: &Path,
    progress: &dyn Progress,
    pause: Option<&mut Pause>,
) -> Result<Vec<String>> {
    let PictureRequest { view, lod, .. } = request;
    if tiled::needs_pieces(&renderer.gpu, view.size, None) {
        let [width, height] = view.size;
        return Err(Error::Request(format!(
            "cannot write layers of {width}x{height} pixels: such pictures are drawn in pieces; make it smaller"
        )));
    }
    let taken = renderer.load(cloud, view, &lod.of(view.size), progress)?;
    let config = renderer.config(cloud, view)?;
    let done = renderer.draw_pausing(cloud, view, &config, progress, pause, |g, outcome| {
        Downloads::ask(g, outcome, false, true)
    })?;
    done.asked.write(&done.frame, view.size, None, Some(path), Overlay::default())?;
    let notes = taken.into_iter().flat_map(|taken| taken.notes);
    let warnings = config.warnings(renderer.cloud(cloud)?.1.resident());
    Ok(notes.chain(warnings).chain(done.notes).collect())
}

/// Writes the linear picture (its alpha is the coverage) and the layers.
fn write_layers(
    path: &Path,
    size: [u32; 2],
    frame: &CompletedSubmission,
    downloads: &Downloads,
) -> Result<()> {
    let picture: &[[f32; 4]] = frame.read(downloads.linear.as_ref().expect("asked for with --exr"));
    let depth: &[f32] = frame.read(downloads.depth.as_ref().expect("asked for with --exr"));
    let index: &[u32] = frame.read(downloads.index.as_ref().expect("asked for with --exr"));
    let projected_depth: &[f32] =
        frame.read(downloads.projected_depth.as_ref().expect("asked for with --exr"));
    // Pixels of unknown depth are empty in the file.
    let depth: Vec<f32> =
        depth.iter().map(|&z| if z == f32::NEG_INFINITY { f32::INFINITY } else { z }).collect();
    let projected_index: &[u32] =
        frame.read(downloads.projected_index.as_ref().expect("asked for with --exr"));
    let coverage = |i: usize| match depth[i].is_finite() {
        false => 0,
        true if index[i] == crate::config::NO_POINT || index[i] != projected_index[i] => 2,
        true => 1,
    };
    let coverage = (0..depth.len()).map(coverage).collect();
    let channel = |c: usize| Samples::Float(picture.iter().map(|pixel| pixel[c]).collect());
    let normal: &[[f32; 4]] = frame.read(downloads.normal.as_ref().expect("asked for with --exr"));
    let normal = |axis: usize| Samples::Float(normal.iter().map(|normal| normal[axis]).collect());
    let shading = downloads.shading.as_ref().map_or_else(
        || vec![1.0; projected_depth.len()],
        |shading| frame.read::<f32>(shading).to_vec(),
    );
    let channels = vec![
        ("R", channel(0)),
        ("G", channel(1)),
        ("B", channel(2)),
        ("A", channel(3)),
        ("depth.Z", Samples::Float(depth)),
        ("index.V", Samples::Id(index.to_vec())),
        ("coverage.V", Samples::Id(coverage)),
        ("normal.X", normal(0)),
        ("normal.Y", normal(1)),
        ("normal.Z", normal(2)),
        ("lit.V", Samples::Float(shading)),
        ("raw.Z", Samples::Float(projected_depth.to_vec())),
    ];
    image_io::write_exr(path, size, channels)
}
