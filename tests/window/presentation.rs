//! Presentations in flight while pages of an index are reused.

use crate::display::Display;
use crate::points::{Random, bumpy};
use crate::tree::{Shape, plant};
use glam::DVec3;
use pointillist::cloud::attribute::{Attribute, DisplayAttribute};
use pointillist::gpu::DeviceOptions;
use pointillist::graph::{Gpu, Graph, Handle};
use pointillist::passes::encode::{self, Screen};
use pointillist::present::Present;
use pointillist::progress::Silent;
use pointillist::render::frame;
use pointillist::render::settings::{FrameConfig, RenderSettings};
use pointillist::resident::pages::PAGE_BYTES;
use pointillist::resident::streaming::Residency;
use pointillist::select::lod::Detail;
use pointillist::view::{Camera, Projection, View};
use std::sync::Arc;
use std::time::Duration;
use winit::application::ApplicationHandler;
use winit::dpi::PhysicalSize;
use winit::event::WindowEvent;
use winit::event_loop::{ActiveEventLoop, EventLoop};
use winit::platform::pump_events::EventLoopExtPumpEvents;
use winit::platform::x11::EventLoopBuilderExtX11;
use winit::window::{Window, WindowId};

const SIZE: [u32; 2] = [640, 480];

/// A window and nothing else.
#[derive(Default)]
struct Bare(Option<Arc<Window>>);

impl ApplicationHandler for Bare {
    fn resumed(&mut self, events: &ActiveEventLoop) {
        let attributes = Window::default_attributes()
            .with_title("presents")
            .with_inner_size(PhysicalSize::new(SIZE[0], SIZE[1]));
        self.0 = Some(Arc::new(events.create_window(attributes).unwrap()));
    }

    fn window_event(&mut self, _events: &ActiveEventLoop, _window: WindowId, _event: WindowEvent) {}
}

fn view(seed: u64) -> View {
    let mut random = Random(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1);
    let mut point = |reach: f64| DVec3::from_array([(); 3].map(|()| random.within(-reach, reach)));
    let camera = Camera {
        eye: point(16.0),
        target: point(6.0),
        up: DVec3::Z,
        fov_y: 55.0,
        projection: Projection::Perspective,
        ortho_height: None,
    };
    View::new(camera, SIZE).unwrap()
}

/// Draws a picture and presents it twice, the second time as under another panel. Returns its
/// pixels, and whether the device was still busy after `meanwhile`.
fn draw(
    gpu: &mut Gpu,
    present: &mut Present,
    residency: &mut Residency,
    view: &View,
    meanwhile: impl FnOnce(&mut Gpu, &mut Residency),
) -> (Vec<u32>, bool) {
    assert!(present.fit(gpu, SIZE).unwrap() && present.size() == SIZE);
    let config = FrameConfig::new(&RenderSettings::default(), view, residency.resident());
    let mut g = Graph::new(gpu);
    let outcome = frame::record(&mut g, view, residency.resident(), &config).unwrap();
    let mut screen =
        Screen { words: g.import("screen", present.screen()), blue_first: present.blue_first() };
    encode::record(&mut g, &outcome.picture, &mut screen).unwrap();
    let words = g.download_buffer(&screen.words);
    let running = g.submit_async(&[screen.words.resource()]).unwrap();
    meanwhile(gpu, residency);
    let at_work = !running.is_done();
    present.set_picture_size(gpu, SIZE).unwrap();
    assert!(present.show(gpu).unwrap() && present.show(gpu).unwrap());
    let frame = running.finish(gpu).expect("drawn, and no validation message");
    let words = frame.read(&words).to_vec();
    (words, at_work)
}

#[test]
fn pages_of_frames_in_flight_are_not_reused() {
    let screen = Display::open();
    // SAFETY: Only this test calls C code, which may read the environment without a lock, and its
    // other threads have not begun. Tests beside it use the standard library, which has a lock.
    unsafe {
        std::env::set_var("DISPLAY", &screen.name);
        std::env::remove_var("WAYLAND_DISPLAY");
    }
    let folder = tempfile::tempdir().unwrap();
    let (points, colors) = bumpy(24_000, 20_000, &mut Random(0xC10D));
    let index = plant(&folder.path().join("cloud.pnti"), &points, &colors, &Shape::default());
    let mut events = EventLoop::builder().with_any_thread(true).build().unwrap();
    let mut bare = Bare::default();
    while bare.0.is_none() {
        events.pump_app_events(Some(Duration::from_millis(10)), &mut bare);
    }
    let mut gpu =
        Gpu::open(&DeviceOptions { validate: true, window: true, ..DeviceOptions::default() })
            .unwrap();
    let mut present = Present::open(&gpu, bare.0.clone().unwrap()).unwrap();
    let shown = DisplayAttribute::indexed(Attribute::Rgb, [0.0, 1.0], [0, 255]);
    // Less than what the views show.
    let mut residency = Residency::open(&mut gpu, index, shown, 60 * PAGE_BYTES).unwrap();
    let few = Detail { budget: 6000, lod_px: 0.0, ..Detail::of(SIZE) };
    let mut overlaps = 0;
    for seed in 0..16 {
        let own = view(seed);
        residency.wait_until_resident(&mut gpu, &own, &few, &Silent).unwrap();
        let evictions = residency.evictions;
        let (disturbed, at_work) =
            draw(&mut gpu, &mut present, &mut residency, &own, |gpu, residency| {
                for step in 0..3 {
                    residency.update(gpu, &view(100 + 3 * seed + step), &few).unwrap();
                }
            });
        overlaps += (at_work && residency.evictions > evictions) as u32;
        residency.wait_until_resident(&mut gpu, &own, &few, &Silent).unwrap();
        let (alone, _) = draw(&mut gpu, &mut present, &mut residency, &own, |_, _| ());
        assert!(disturbed == alone, "picture {seed} shows pages of other nodes");
    }
    assert!(overlaps > 0, "no page was given away while a picture was under way");
    gpu.device.take_validation_errors().unwrap();
}
