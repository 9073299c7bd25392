//! Pictures over what the host has drawn: in a part of its images, and blended.

use super::*;
use pointillist::cloud::colormap::srgb_to_linear;

/// Returns numbers that repeat late.
fn noise() -> impl FnMut() -> u32 {
    let mut state = 7u32;
    move || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        state >> 8
    }
}

/// All targets, filled before a frame.
fn filled(application: &Application, clear: bool) -> Targets {
    let copied = Access::any(vk::ImageLayout::TRANSFER_DST_OPTIMAL.as_raw());
    let of = |target: Target| Target { clear, before: copied, ..target };
    let targets = application.targets();
    Targets {
        color: of(targets.color),
        depth: targets.depth.map(of),
        ids: targets.ids.map(of),
        normals: targets.normals.map(of),
        ..targets
    }
}

#[test]
fn an_area_is_a_picture_of_its_own_and_the_rest_stays() {
    let folder = tempfile::tempdir().unwrap();
    let (path, camera) = scan(folder.path());
    let mut application = Application::new(COLOR);
    let mut renderer = application.renderer();
    renderer.set("effect", "antialias=on").unwrap();
    renderer.open(std::slice::from_ref(&path), &OpenSettings::default()).unwrap();
    let size = [160, 120];
    let view = |corner| FrameView { area: Area { corner, size }, ..view_of(camera) };
    let (at_first, inside) = ([0, 0], [70, 50]);
    let targets = application.targets();
    application.settle(&mut renderer, targets, &[view(at_first)]);
    // What is there, at two places of the area.
    let mut next = noise();
    let around: Vec<[u8; 4]> = (0..PIXELS).map(|_| next().to_le_bytes()).collect();
    let own: Vec<[u8; 4]> = (0..PIXELS).map(|_| next().to_le_bytes()).collect();
    let depth_around: Vec<f32> = (0..PIXELS).map(|_| (next() % 1000) as f32 / 1000.0).collect();
    // A third of the points is behind the host's.
    let depth_own: Vec<f32> = (0..PIXELS).map(|i| [0.0, 0.0, 1.0][i % 3]).collect();
    let place = |i: usize, corner: [i32; 2]| {
        let [x, y] = [i % SIZE[0] as usize, i / SIZE[0] as usize];
        let [x, y] = [x as i64 - corner[0] as i64, y as i64 - corner[1] as i64];
        let within = x >= 0 && y >= 0 && x < size[0] as i64 && y < size[1] as i64;
        within.then_some(y as usize * SIZE[0] as usize + x as usize)
    };
    for clear in [true, false] {
        let mut draw = |corner: [i32; 2]| {
            let at = |i| place(i, corner);
            let colors: Vec<_> = (0..PIXELS).map(|i| at(i).map_or(around[i], |k| own[k])).collect();
            let depths: Vec<_> =
                (0..PIXELS).map(|i| at(i).map_or(depth_around[i], |k| depth_own[k])).collect();
            let targets = filled(&application, clear);
            let before = Some((colors.as_flattened(), &depths[..]));
            let (report, color, depth) =
                application.draw(&mut renderer, targets, &[view(corner)], before);
            assert!(report.points > 0);
            let (ids, normals) = application.layers.clone();
            (color, depth, ids, normals)
        };
        draw(at_first);
        let alone = draw(at_first);
        draw(inside);
        let placed = draw(inside);
        let (mut seen, mut hidden) = (0, 0);
        for i in 0..PIXELS {
            let color = &placed.0[4 * i..][..4];
            let Some(k) = place(i, inside) else {
                assert_eq!(color, around[i], "colour beside the area, {i}");
                assert_eq!(placed.1[i], depth_around[i], "depth beside the area, {i}");
                // SAFETY: the numbers that ids are filled with; normals have their bits.
                let filled = unsafe { (FILLED.uint32, FILLED.float32) };
                assert_eq!(placed.2[i], filled.0[..2], "ids beside the area, {i}");
                assert_eq!(placed.3[i].map(f32::to_bits), filled.1.map(f32::to_bits), "{i}");
                continue;
            };
            assert_eq!(color, &alone.0[4 * k..][..4], "colour in the area, {i}, {clear}");
            assert_eq!(placed.1[i], alone.1[k], "depth in the area, {i}, {clear}");
            assert_eq!((placed.2[i], placed.3[i]), (alone.2[k], alone.3[k]), "{i}, {clear}");
            seen += (color != own[k]) as u32;
            hidden += (color == own[k]) as u32;
        }
        println!("clear {clear}: {seen} pixels are drawn, {hidden} are the host's");
        assert!(seen > 3000 && (hidden > 3000) != clear, "{clear}: {seen} {hidden}");
    }
}

/// Premultiplied colours over the host's: in every encoding what f64 says of the linear picture.
#[test]
fn transparent_pictures_are_blended_as_f64_says() {
    let folder = tempfile::tempdir().unwrap();
    let (path, camera) = scan(folder.path());
    let mut next = noise();
    let host: Vec<[f64; 3]> =
        (0..PIXELS).map(|_| [0; 3].map(|_| (next() % 256) as f64 / 255.0)).collect();
    // Draws over what `store` makes of the host's colours.
    let draw = |format, encoding, store: &dyn Fn([f64; 3]) -> Vec<u8>| {
        let mut application = Application::new(format);
        let mut renderer = application.renderer();
        renderer.set("opacity", "0.5").unwrap();
        renderer.set("effect", "antialias=on").unwrap();
        renderer.open(std::slice::from_ref(&path), &OpenSettings::default()).unwrap();
        let mut targets = filled(&application, false);
        (targets.depth, targets.ids, targets.normals) = (None, None, None);
        targets.encoding = encoding;
        let view = [view_of(camera)];
        let mut clean = targets;
        clean.color = application.targets().color;
        application.settle(&mut renderer, clean, &view);
        let before: Vec<u8> = host.iter().flat_map(|&color| store(color)).collect();
        let depths = vec![0.0; PIXELS];
        for _ in 0..20 {
            let over = Some((&before[..], &depths[..]));
            let (report, color, _) = application.draw(&mut renderer, targets, &view, over);
            if report.settled {
                return color;
            }
        }
        panic!("the picture never settles");
    };
    // The linear picture itself, over nothing.
    let nothing = |_: [f64; 3]| vec![0u8; 16];
    let linear = draw(vk::Format::R32G32B32A32_SFLOAT, Encoding::Linear, &nothing);
    let linear: Vec<[f32; 4]> = bytemuck::pod_collect_to_vec(&linear);
    let half_covered = linear.iter().filter(|c| c[3] > 0.0 && c[3] < 1.0).count();
    let mut alphas: Vec<u32> = linear.iter().map(|c| c[3].to_bits()).collect();
    alphas.sort_unstable();
    alphas.dedup();
    println!("{half_covered} pixels let light through, with {} opacities", alphas.len());
    assert!(half_covered > 10_000 && alphas.len() > 20);

    let codes = |order: [usize; 3]| {
        move |color: [f64; 3]| {
            let [a, b, c] = order.map(|i| (color[i] * 255.0).round() as u8);
            vec![a, b, c, 255]
        }
    };
    let ten = |color: [f64; 3]| {
        let [r, g, b] = color.map(|c| (c * 1023.0).round() as u32);
        (r | g << 10 | b << 20 | 3 << 30).to_le_bytes().to_vec()
    };
    let halves = |color: [f64; 3]| {
        let [r, g, b] = color.map(half::f16::from_f64);
        [r, g, b, half::f16::ONE].iter().flat_map(|c| c.to_le_bytes()).collect()
    };
    let of_codes = |order: [usize; 3]| move |texel: &[u8]| order.map(|i| texel[i] as f64 / 255.0);
    let of_ten = |texel: &[u8]| {
        let word = u32::from_le_bytes(texel.try_into().unwrap());
        [0, 10, 20].map(|shift| (word >> shift & 1023) as f64 / 1023.0)
    };
    let of_halves = |texel: &[u8]| {
        [0, 2, 4].map(|at| half::f16::from_le_bytes([texel[at], texel[at + 1]]).to_f64())
    };
    type Store<'s> = &'s dyn Fn([f64; 3]) -> Vec<u8>;
    type Load<'s> = &'s dyn Fn(&[u8]) -> [f64; 3];
    let eight = |linear: f64| (linear_to_srgb(linear) * 255.0).round() / 255.0;
    let (usual, swapped) = ([0, 1, 2], [2, 1, 0]);
    let (store, store_swapped) = (codes(usual), codes(swapped));
    let (load, load_swapped) = (of_codes(usual), of_codes(swapped));
    let (srgb, plain) = (Encoding::Srgb, Encoding::Linear);
    use vk::Format as F;
    // How a linear colour is stored, and whether the device encodes after it has blended. The last
    // number is the step of what is stored.
    type Code<'c> = &'c dyn Fn(f64) -> f64;
    let identity = |linear: f64| linear;
    let curve = |linear: f64| linear_to_srgb(linear);
    let cases: [(F, Encoding, Store, Load, Code, bool, f64); 7] = [
        (F::R8G8B8A8_UNORM, srgb, &store, &load, &eight, false, 1.0 / 255.0),
        (F::B8G8R8A8_UNORM, srgb, &store_swapped, &load_swapped, &eight, false, 1.0 / 255.0),
        (F::R8G8B8A8_UNORM, plain, &store, &load, &identity, false, 1.0 / 255.0),
        (F::R8G8B8A8_SRGB, srgb, &store, &load, &eight, true, 1.0 / 255.0),
        (F::A2B10G10R10_UNORM_PACK32, srgb, &ten, &of_ten, &curve, false, 1.0 / 1023.0),
        (F::R16G16B16A16_SFLOAT, srgb, &halves, &of_halves, &curve, false, 1.0 / 1024.0),
        (F::R16G16B16A16_SFLOAT, plain, &halves, &of_halves, &identity, false, 1.0 / 1024.0),
    ];
    for (format, encoding, store, load, code, encodes, step) in cases {
        let drawn = draw(format, encoding, store);
        let texels = drawn.chunks_exact(drawn.len() / PIXELS);
        let mut most = 0.0f64;
        for (i, (texel, picture)) in texels.zip(&linear).enumerate() {
            let found = load(texel);
            let before = load(&store(host[i]));
            let alpha = picture[3] as f64;
            for c in 0..3 {
                let own = if alpha > 0.0 { (picture[c] as f64 / alpha).max(0.0) } else { 0.0 };
                let blended = match encodes {
                    false => code(own) * alpha + before[c] * (1.0 - alpha),
                    true => {
                        let own = srgb_to_linear(code(own));
                        linear_to_srgb(own * alpha + srgb_to_linear(before[c]) * (1.0 - alpha))
                    }
                };
                // Normalised numbers end at 1.
                let most_stored = if format == F::R16G16B16A16_SFLOAT { f64::MAX } else { 1.0 };
                most = most.max((found[c] - blended.min(most_stored)).abs());
            }
        }
        println!("{format:?} {encoding:?}: off by {:.3} steps", most / step);
        // The colour is rounded, and what is blended of it.
        assert!(most <= 2.0 * step, "{format:?} {encoding:?}: {most}");
    }
}
