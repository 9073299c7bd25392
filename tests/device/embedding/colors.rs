//! Colours are those that `render` writes, in every format of the host.

use super::*;

#[test]
fn an_embedded_frame_is_that_of_render_byte_for_byte() {
    let folder = tempfile::tempdir().unwrap();
    let (path, camera) = scan(folder.path());
    let all = ["edl=on", "shadows=on", "ao=on", "antialias=on"];
    let styles = [Style::Surface, Style::Surface, Style::Strokes];
    for (style, effects) in styles.into_iter().zip([&[][..], &all, &[]]) {
        let effects_of_style = Effects::of(style);
        let mut settings = RenderSettings { effects: effects_of_style, ..Default::default() };
        effects.iter().for_each(|effect| settings.effects.set(effect).unwrap());
        let expected = rendered(&path, camera, &settings);
        let mut application = Application::new(COLOR);
        let mut renderer = application.renderer();
        renderer.set_settings(settings);
        let cloud = renderer.open(std::slice::from_ref(&path), &OpenSettings::default()).unwrap();
        let targets = application.targets();
        let (report, color, depth) = application.settle(&mut renderer, targets, &[view_of(camera)]);
        assert_eq!(renderer.state(cloud).unwrap(), CloudState::Ready);
        assert!(report.points > 0 && report.effects.iter().any(|effect| effect.runs));
        assert!(without_alpha(&color) == expected.color, "colours differ, {style:?} {effects:?}");
        let division = division_error(&application.device);
        let (ids, normals) = &application.layers;
        for (i, (&host, &planar)) in depth.iter().zip(&expected.depth).enumerate() {
            let seen = planar.is_finite() && planar > 0.0;
            let id = if seen { [expected.ids[i], cloud.0 as u32] } else { [NO_POINT, 0] };
            assert_eq!(ids[i], id, "pixel {i}");
            let [x, y, z, _] = if seen { expected.normals[i] } else { [0.0; 4] };
            assert_eq!(normals[i], [x, y, z, 0.0], "pixel {i}");
            let expected = if planar.is_finite() && planar > 0.0 { 0.01f32 / planar } else { 0.0 };
            let error = (host - expected).abs();
            assert!(error <= division * expected, "pixel {i}: {host}, {expected}");
        }
        // A second frame is the same, and takes no new memory.
        let (_, again, _) = application.draw(&mut renderer, targets, &[view_of(camera)], None);
        assert!(again == color);
        drop(renderer);
    }
}

/// Compares a frame whose settings are set by words with that of `render --scene`.
#[test]
fn a_scene_is_drawn_as_render_draws_its_file() {
    let folder = tempfile::tempdir().unwrap();
    let (path, camera) = scan(folder.path());
    let words = [
        ("effect", "edl=on,strength=2"),
        ("effect", "ao=on"),
        ("effect", "phong=on"),
        ("light", "direction:1,2,-3"),
        ("background", "1e3c5a"),
        ("opacity", "0.75"),
        ("clip", "box:-2,-2,-1,0.5,2,1"),
        ("ramp", "turbo"),
        ("range", "-0.3,0.25"),
        ("brightness", "0.05"),
        ("contrast", "1.2"),
        ("gamma", "1.5"),
    ];
    let of = |name: &str| {
        words.iter().filter(|(own, _)| *own == name).map(|(_, value)| *value).collect::<Vec<_>>()
    };
    let number = |name: &str| of(name)[0].parse::<f64>().unwrap();
    let scene = serde_json::json!({
        "camera": camera,
        "color": "elevation",
        "scale": {
            "ramp": of("ramp")[0],
            "range": [-0.3, 0.25],
            "brightness": number("brightness"),
            "contrast": number("contrast"),
            "gamma": number("gamma"),
        },
        "effects": of("effect"),
        "opacity": of("opacity"),
        "clip": of("clip"),
        "light": of("light")[0],
        "background": of("background")[0],
    });
    let [file, picture] = ["scene.json", "scene.png"].map(|name| folder.path().join(name));
    std::fs::write(&file, scene.to_string()).unwrap();
    let [width, height] = SIZE;
    let (file, to) = (file.display(), picture.display());
    let exr = folder.path().join("scene.exr");
    let layers = exr.display();
    let line = format!("--scene {file} -o {to} --exr {layers} --size {width}x{height}");
    crate::program::succeeded(&crate::program::render(&path, &line));
    let expected = crate::png_file::read_png(&picture);
    assert_eq!(expected.size, SIZE);

    let mut application = Application::new(COLOR);
    let mut renderer = application.renderer();
    words.iter().for_each(|(name, value)| renderer.set(name, value).unwrap());
    let settings = OpenSettings { color: Some("elevation".into()), ..OpenSettings::default() };
    renderer.open(&[path], &settings).unwrap();
    let targets = application.targets();
    let (report, color, depth) = application.settle(&mut renderer, targets, &[view_of(camera)]);
    assert!(report.points > 0);
    let layers = crate::exr_file::read_exr(&exr);
    let division = division_error(&application.device);
    let (planar, index) = (layers.floats("depth.Z"), &layers.layers["index.V"]);
    for pixel in 0..PIXELS {
        let seen = planar[pixel].is_finite() && planar[pixel] > 0.0;
        let id = if seen { index[pixel] } else { NO_POINT };
        assert_eq!(application.layers.0[pixel][0], id, "pixel {pixel}");
        let stored = if seen { 0.01f32 / planar[pixel] } else { 0.0 };
        let error = (depth[pixel] - stored).abs();
        assert!(error <= division * stored, "pixel {pixel}: {} {stored}", depth[pixel]);
    }
    assert!(index.iter().any(|&id| id != NO_POINT));
    let differ = color.chunks(4).zip(&expected.pixels).filter(|(a, b)| a[..3] != b[..3]).count();
    assert_eq!(differ, 0, "pixels differ");
    // Each of them is seen.
    let plain = ["ramp=auto", "range=auto", "brightness=0", "contrast=1", "gamma=1", "opacity=1"];
    for word in plain {
        let (name, value) = word.split_once('=').unwrap();
        renderer.set(name, value).unwrap();
        let (_, other, _) = application.settle(&mut renderer, targets, &[view_of(camera)]);
        assert!(other != color, "{word} changes nothing");
        renderer.set(name, of(name)[0]).unwrap();
    }
    let (_, again, _) = application.settle(&mut renderer, targets, &[view_of(camera)]);
    assert!(again == color);
}

#[test]
fn a_host_that_encodes_gets_the_same_codes() {
    let folder = tempfile::tempdir().unwrap();
    let (path, camera) = scan(folder.path());
    let mut pictures = Vec::new();
    for format in [COLOR, vk::Format::R8G8B8A8_SRGB] {
        let mut application = Application::new(format);
        let mut renderer = application.renderer();
        renderer.open(std::slice::from_ref(&path), &OpenSettings::default()).unwrap();
        let targets = application.targets();
        pictures.push(application.settle(&mut renderer, targets, &[view_of(camera)]).1);
    }
    assert!(without_alpha(&pictures[0]) == without_alpha(&pictures[1]));
}

/// Formats of more bits, and of another order, have the same colours.
#[test]
fn colours_are_those_of_eight_bits_in_every_format() {
    let folder = tempfile::tempdir().unwrap();
    let (path, camera) = scan(folder.path());
    let draw = |format, encoding| {
        let mut application = Application::new(format);
        let mut renderer = application.renderer();
        renderer.open(std::slice::from_ref(&path), &OpenSettings::default()).unwrap();
        let mut targets = application.targets();
        targets.encoding = encoding;
        application.settle(&mut renderer, targets, &[view_of(camera)]).1
    };
    let eight = draw(COLOR, Encoding::Srgb);
    // Codes 0..=1 of red, green and blue.
    let ten_bits = |texel: &[u8]| {
        let word = u32::from_le_bytes(texel.try_into().unwrap());
        [0, 10, 20].map(|shift| (word >> shift & 1023) as f64 / 1023.0)
    };
    let half = |texel: &[u8]| {
        [0, 2, 4].map(|at| half::f16::from_le_bytes([texel[at], texel[at + 1]]).to_f64())
    };
    let encoded = |texel: &[u8]| half(texel).map(linear_to_srgb);
    let swapped = |texel: &[u8]| [2, 1, 0].map(|at| texel[at] as f64 / 255.0);
    type Codes<'c> = &'c dyn Fn(&[u8]) -> [f64; 3];
    let (srgb, linear) = (Encoding::Srgb, Encoding::Linear);
    // Devices may round a stored value either way (Vulkan 1.3, "Conversion From Floating-Point to
    // Normalized Fixed-Point").
    let cases: [(_, _, Codes, f64); 4] = [
        (vk::Format::B8G8R8A8_UNORM, srgb, &swapped, 0.0),
        (vk::Format::A2B10G10R10_UNORM_PACK32, srgb, &ten_bits, 1.0 / 1023.0),
        (vk::Format::R16G16B16A16_SFLOAT, srgb, &half, 1.0 / 2048.0),
        // The steps of halves, encoded.
        (vk::Format::R16G16B16A16_SFLOAT, linear, &encoded, 1.0 / 2048.0),
    ];
    for (format, encoding, codes, step) in cases {
        let picture = draw(format, encoding);
        let texels = picture.chunks_exact(picture.len() / PIXELS).zip(eight.chunks_exact(4));
        let (mut most, mut opaque) = (0.0f64, 0);
        for (texel, eight) in texels {
            // Eight bits are rounded before and after they are multiplied by the coverage.
            let roundings = if eight[3] == 255 { 0.5 } else { 1.0 };
            if encoding == Encoding::Linear && eight[3] < 255 {
                continue;
            }
            opaque += (eight[3] == 255) as usize;
            let codes = codes(texel);
            let off = [0, 1, 2].map(|c| (codes[c] - eight[c] as f64 / 255.0).abs());
            most = off.into_iter().fold(most, |most, off| most.max(off - roundings / 255.0));
        }
        println!("{format:?} {encoding:?}: {most} beside rounding, of {step}");
        assert!(most <= step && opaque > 10_000, "{format:?} {encoding:?}: {most} {opaque}");
        // Eight bits are not what it was made from.
        let distinct: std::collections::HashSet<&[u8]> =
            picture.chunks_exact(picture.len() / PIXELS).collect();
        let of_eight: std::collections::HashSet<&[u8]> = eight.chunks_exact(4).collect();
        assert!(distinct.len() >= of_eight.len(), "{} {}", distinct.len(), of_eight.len());
    }
}
