//! A renderer under random calls for a long time, for `tools/soak`. Now and then it adds its clouds
//! anew, draws them as they are usually drawn, prints a line, and waits for a line of standard
//! input: its memory is read there. It fails if its last picture is not that of a new renderer.
//!
//! ```sh
//! cargo run --release --example soak_renderer -- SECONDS SECONDS_BETWEEN_RESTS CLOUD...
//! ```

use pointillist::gpu::device::DeviceOptions;
use pointillist::renderer::{
    Camera, Clips, CloudId, Error, Opacities, OpenSettings, Preset, RenderSettings, Renderer,
    RendererOptions, Result,
};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

const SIZES: [[u32; 2]; 3] = [[320, 180], [400, 300], [199, 333]];
const EFFECTS: [&str; 6] =
    ["edl=on", "shadows=on", "strokes=on", "fill=off", "visibility=off", "ao=on"];

/// More frames than those after which memory that goes unused is freed.
const FRAMES_AT_REST: usize = 80;

/// Random numbers: xorshift64 (Marsaglia 2003).
struct Random(u64);

impl Random {
    fn below(&mut self, end: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 20) as usize % end
    }

    fn part(&mut self) -> f64 {
        self.below(1 << 20) as f64 / (1 << 20) as f64
    }
}

fn opened() -> Result<Renderer> {
    // So small that nodes of an index make room for others.
    let options = RendererOptions { memory_budget: 16 << 20, ..RendererOptions::default() };
    Renderer::open_device(&DeviceOptions::default(), options)
}

/// A cloud, and the settings under which it was opened: only strokes make it ready for strokes.
struct Opened {
    id: CloudId,
    settings: RenderSettings,
}

fn add(renderer: &mut Renderer, file: &Path) -> Result<Opened> {
    let settings = renderer.settings().clone();
    let id = renderer.open(&[file.to_owned()], &OpenSettings::default())?;
    renderer.wait(id)?;
    Ok(Opened { id, settings })
}

/// Draws one cloud by usual settings; all others are invisible.
fn usual(
    renderer: &mut Renderer,
    clouds: &[Opened],
    shown: CloudId,
    camera: Camera,
) -> Result<Vec<u8>> {
    renderer.set_settings(RenderSettings::default());
    renderer.set_filters(Opacities::default(), Clips::default());
    clouds.iter().try_for_each(|cloud| renderer.set_visible(cloud.id, cloud.id == shown))?;
    renderer.picture(shown, camera, SIZES[1])
}

/// Calls one function of the renderer, or draws.
fn act(
    renderer: &mut Renderer,
    clouds: &mut [Opened],
    files: &[PathBuf],
    random: &mut Random,
) -> Result<()> {
    let chosen = random.below(clouds.len());
    match random.below(12) {
        0 => {
            renderer.remove(clouds[chosen].id)?;
            clouds[chosen] = add(renderer, &files[chosen])?;
        }
        1 | 2 => {
            let mut settings = RenderSettings::default();
            settings.effects.set(EFFECTS[random.below(EFFECTS.len())]).map_err(Error::Request)?;
            renderer.set_settings(settings);
        }
        3 => {
            let rule = ["class:6=0.3", "class:2=0", "0.5"][random.below(3)];
            let rules = Opacities(vec![rule.parse().map_err(Error::Request)?]);
            renderer.set_filters(rules, Clips::default());
        }
        _ => {
            for (k, cloud) in clouds.iter().enumerate() {
                renderer.set_visible(cloud.id, k == chosen)?;
            }
            let size = SIZES[random.below(SIZES.len())];
            let Some(camera) = renderer.framing(Preset::Iso, size) else { return Ok(()) };
            let nearer = 0.05 + 1.2 * random.part();
            let turn = glam::DMat3::from_rotation_z(std::f64::consts::TAU * random.part());
            let eye = camera.target + turn * ((camera.eye - camera.target) * nearer);
            renderer.picture(clouds[chosen].id, Camera { eye, ..camera }, size)?;
        }
    }
    Ok(())
}

/// Returns to the state of the start, and draws until memory that goes unused is freed.
fn rest(renderer: &mut Renderer, clouds: &mut [Opened], files: &[PathBuf]) -> Result<()> {
    renderer.set_settings(RenderSettings::default());
    for (cloud, file) in clouds.iter_mut().zip(files) {
        renderer.remove(cloud.id)?;
        *cloud = add(renderer, file)?;
    }
    let Some(camera) = renderer.framing(Preset::Fit, SIZES[1]) else { return Ok(()) };
    for k in 0..FRAMES_AT_REST {
        usual(renderer, clouds, clouds[k % clouds.len()].id, camera)?;
    }
    Ok(())
}

fn main() -> std::result::Result<(), Box<dyn std::error::Error>> {
    pointillist::app::allocator::return_large_arrays();
    let mut arguments = std::env::args().skip(1);
    let mut duration = || -> std::result::Result<_, Box<dyn std::error::Error>> {
        let seconds = arguments.next().ok_or("give two numbers of seconds, and clouds")?;
        Ok(Duration::from_secs(seconds.parse()?))
    };
    let (lasts, between) = (duration()?, duration()?);
    let files: Vec<PathBuf> = arguments.map(PathBuf::from).collect();
    let mut renderer = opened()?;
    let added = files.iter().map(|file| add(&mut renderer, file));
    let mut clouds = added.collect::<Result<Vec<_>>>()?;
    let (began, mut random) = (Instant::now(), Random(39));
    while began.elapsed() < lasts {
        let rests = Instant::now() + between;
        while Instant::now() < rests {
            act(&mut renderer, &mut clouds, &files, &mut random)?;
        }
        rest(&mut renderer, &mut clouds, &files)?;
        println!("at rest");
        std::io::stdin().read_line(&mut String::new())?;
    }
    // It frames all clouds, of which a new renderer has one.
    let camera = renderer.framing(Preset::Fit, SIZES[1]).ok_or("give clouds with points")?;
    for (k, file) in files.iter().enumerate() {
        let last = usual(&mut renderer, &clouds, clouds[k].id, camera)?;
        let mut fresh = opened()?;
        fresh.set_settings(clouds[k].settings.clone());
        let cloud = add(&mut fresh, file)?;
        let id = cloud.id;
        if last != usual(&mut fresh, &[cloud], id, camera)? {
            return Err(format!("{}: the last picture is not the first one", file.display()).into());
        }
    }
    Ok(())
}
