//! Encoding on the device gives the bytes of the CPU's thresholds, with which files are encoded.

use super::{SIZES, cameras, scene};
use crate::gpu::{WAYS, bare, with};
use pointillist::cloud::attribute::DisplayAttribute;
use pointillist::graph::Graph;
use pointillist::passes::encode::{self, Screen, Thresholds};
use pointillist::progress::Silent;
use pointillist::render::frame;
use pointillist::render::settings::FrameConfig;
use pointillist::resident::Resident;
use pointillist::view::View;

#[test]
fn a_screen_holds_the_bytes_of_a_file() {
    let (cloud, thresholds) = (scene(20_000), Thresholds::new());
    for size in SIZES {
        for blue_first in [false, true] {
            let view = View::new(cameras()[0], size).unwrap();
            let (picture, words) = with(WAYS[0], |gpu| {
                let (shown, _) = DisplayAttribute::automatic(&cloud);
                let resident = Resident::fill(gpu, cloud.clone(), shown, &Silent).unwrap();
                let config = FrameConfig::new(&bare(), &view, &resident);
                let mut g = Graph::new(gpu);
                let outcome = frame::record(&mut g, &view, &resident, &config).unwrap();
                let words = g.buffer("screen", 4 * size[0] as u64 * size[1] as u64);
                let mut screen = Screen { words, blue_first };
                encode::record(&mut g, &outcome.picture, &mut screen).unwrap();
                let (picture, words) =
                    (g.download(&outcome.picture), g.download_buffer(&screen.words));
                let frame = g.submit_and_wait(&[]).expect("encoded, and no validation message");

                (frame.read::<[f32; 4]>(&picture).to_vec(), frame.read::<[u8; 4]>(&words).to_vec())
            });
            let order = if blue_first { [2, 1, 0] } else { [0, 1, 2] };
            for (pixel, got) in picture.iter().zip(&words) {
                for (byte, channel) in order.into_iter().enumerate() {
                    assert_eq!(
                        got[byte],
                        thresholds.encode(pixel[channel]),
                        "{size:?}: {got:?} of {pixel:?}"
                    );
                }
                assert_eq!(got[3], 255);
            }
        }
    }
}
