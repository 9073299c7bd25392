//! Pictures encoded on the device against the thresholds that files are encoded with on the CPU: the same bytes.

use crate::gpu::{WAYS, bare, with};
use crate::{SIZES, cameras, scene};
use pointillist::cloud::attribute::Shown;
use pointillist::frame;
use pointillist::graph::Graph;
use pointillist::look;
use pointillist::passes::encode::{self, Screen, Thresholds};
use pointillist::progress::Silent;
use pointillist::resident::Resident;
use pointillist::view::View;

#[test]
fn a_screen_holds_the_bytes_of_a_file_and_a_larger_one_what_lies_between_pixels() {
    let (cloud, thresholds) = (scene(20_000), Thresholds::new());
    for size in SIZES {
        for (blue_first, times) in [(false, 1), (true, 1), (true, 3)] {
            let view = View::new(cameras()[0], size).unwrap();
            let screen_size = size.map(|side| side * times);
            let (picture, words) = with(WAYS[0], |gpu| {
                let (shown, _) = Shown::automatic(&cloud);
                let resident = Resident::fill(gpu, cloud.clone(), shown, &Silent).unwrap();
                let look = look::decide(&bare(), &view, &resident);
                let mut g = Graph::new(gpu);
                let outcome = frame::record(&mut g, &view, &resident, &look).unwrap();
                let words = g.buffer("screen", 4 * screen_size[0] as u64 * screen_size[1] as u64);
                let mut screen = Screen { words, size: screen_size, blue_first };
                encode::record(&mut g, &outcome.picture, &mut screen).unwrap();
                let (picture, words) = (g.download(&outcome.picture), g.download_buffer(&screen.words));
                let frame = g.submit(&[]).expect("encoded, and no validation message");
                let read = (frame.read::<[f32; 4]>(&picture).to_vec(), frame.read::<[u8; 4]>(&words).to_vec());
                frame.shelve(gpu);
                resident.free(gpu);
                read
            });
            let [width, height] = size.map(|side| side as i64);
            let at = |x: i64, y: i64| picture[(y.clamp(0, height - 1) * width + x.clamp(0, width - 1)) as usize];
            for (i, got) in words.iter().enumerate() {
                let (x, y) = (i as u32 % screen_size[0], i as u32 / screen_size[0]);
                // f64: the centre of the pixel on the screen, in the picture.
                let place = [x, y].map(|side| (side as f64 + 0.5) / times as f64 - 0.5);
                let first = place.map(f64::floor);
                let [u, v] = [place[0] - first[0], place[1] - first[1]];
                let corners = [(0, 0, (1.0 - u) * (1.0 - v)), (1, 0, u * (1.0 - v)), (0, 1, (1.0 - u) * v), (1, 1, u * v)];
                let order = if blue_first { [2, 1, 0] } else { [0, 1, 2] };
                for (byte, channel) in order.into_iter().enumerate() {
                    let linear: f64 =
                        corners.iter().map(|&(dx, dy, share)| share * at(first[0] as i64 + dx, first[1] as i64 + dy)[channel] as f64).sum();
                    // Of one pixel alone the bytes are exact; between pixels f32 may fall on the other side of a threshold.
                    let slack = if times == 1 { 0.0 } else { 1e-5 };
                    let bounds = [linear - slack, linear + slack].map(|value| thresholds.encode(value as f32));
                    assert!((bounds[0]..=bounds[1]).contains(&got[byte]), "{size:?} x {times}, pixel {x} {y}: {got:?}, {linear}");
                }
                assert_eq!(got[3], 255);
            }
        }
    }
}
