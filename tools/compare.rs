//! A picture against the truth of its scene, for `tools/demo`.
//!
//! In: the EXR layers that `render --exr` and `synth --truth` wrote for one camera. Out: a table on
//! standard output, and both pictures side by side as PNG; or one picture, as a PNG of few colours.
//! Depth errors are relative, and taken away from edges, where a pixel's centre and a point
//! elsewhere in the pixel may lie on different surfaces and both be right. An edge is a kink of
//! more than 1 % in inverse depth, which is affine on every plane, within two pixels.

use exr::prelude::*;
use rayon::prelude::*;

struct Picture {
    size: [usize; 2],
    channels: Vec<(String, Vec<f32>)>,
}

impl Picture {
    fn read(path: &str) -> std::result::Result<Picture, String> {
        let image = read_first_flat_layer_from_file(path)
            .map_err(|error| format!("cannot read {path}: {error}"))?;
        let size = [image.layer_data.size.width(), image.layer_data.size.height()];
        let channels = image.layer_data.channel_data.list;
        let channels = channels
            .into_iter()
            .map(|channel| {
                (channel.name.to_string(), channel.sample_data.values_as_f32().collect())
            })
            .collect();
        Ok(Picture { size, channels })
    }

    fn channel(&self, name: &str) -> std::result::Result<&[f32], String> {
        let found = self.channels.iter().find(|(channel, _)| channel == name);
        found.map(|(_, values)| &values[..]).ok_or(format!("there is no layer {name}"))
    }
}

/// True depth, and what is known from it.
struct Truth<'p> {
    depth: &'p [f32],
    size: [usize; 2],
    kinks: Vec<bool>,
}

impl<'p> Truth<'p> {
    fn new(depth: &'p [f32], size: [usize; 2]) -> Truth<'p> {
        let [width, _] = size;
        let inverse = |pixel: usize| 1.0 / depth[pixel] as f64;
        let kink = |before: usize, pixel: usize, after: usize| {
            let bend = (inverse(before) - 2.0 * inverse(pixel) + inverse(after)).abs()
                * depth[pixel] as f64;
            // Nothing is infinitely far: 1 / depth is 0 there, and the border of it is a kink.
            !depth[pixel].is_finite() || bend > 0.01
        };
        let inside = |pixel: usize| {
            (1..size[0] - 1).contains(&(pixel % width))
                && (1..size[1] - 1).contains(&(pixel / width))
        };
        let kinked = |pixel| {
            inside(pixel)
                && (kink(pixel - 1, pixel, pixel + 1) || kink(pixel - width, pixel, pixel + width))
        };
        Truth { depth, size, kinks: (0..depth.len()).into_par_iter().map(kinked).collect() }
    }

    fn around(&self, pixel: usize, reach: usize) -> impl Iterator<Item = usize> + use<> {
        let [width, height] = self.size;
        let (x, y) = (pixel % width, pixel / width);
        let columns = x.saturating_sub(reach)..(x + reach + 1).min(width);
        (y.saturating_sub(reach)..(y + reach + 1).min(height))
            .flat_map(move |row| columns.clone().map(move |column| row * width + column))
    }

    fn near_edge(&self, pixel: usize) -> bool {
        self.around(pixel, 2).any(|other| self.kinks[other])
    }

    /// What a point anywhere in the pixel may differ by: 1 %, and the slope of the surface.
    fn tolerance(&self, pixel: usize) -> f32 {
        let own = self.depth[pixel];
        self.around(pixel, 1).map(|other| (self.depth[other] - own).abs()).fold(0.0, f32::max)
            + 0.01 * own
    }
}

fn quantile(sorted: &[f32], share: f64) -> f32 {
    sorted
        .get((share * (sorted.len().max(1) - 1) as f64).round() as usize)
        .copied()
        .unwrap_or(f32::NAN)
}

/// IEC 61966-2-1.
fn encode(linear: f32) -> u8 {
    let v = linear.clamp(0.0, 1.0);
    let encoded = if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
    (encoded * 255.0).round() as u8
}

/// sRGB bytes of the pictures, side by side.
fn side_by_side(pictures: &[&Picture]) -> std::result::Result<Vec<[u8; 3]>, String> {
    let [width, height] = pictures[0].size;
    let mut pixels = Vec::with_capacity(width * height * pictures.len());
    let planes: std::result::Result<Vec<_>, String> = pictures
        .iter()
        .map(|picture| Ok([picture.channel("R")?, picture.channel("G")?, picture.channel("B")?]))
        .collect();
    let planes = planes?;
    for row in 0..height {
        for plane in &planes {
            pixels.extend(
                (row * width..(row + 1) * width)
                    .map(|pixel| plane.map(|channel| encode(channel[pixel]))),
            );
        }
    }
    Ok(pixels)
}

/// Median cut (Heckbert 1982): the box of the greatest extent, weighed by the root of its pixels,
/// is halved at its longest axis until there are `count`.
fn palette(pixels: &[[u8; 3]], count: usize) -> Vec<[u8; 3]> {
    let extent = |colors: &[[u8; 3]]| {
        let of = |axis: usize| {
            colors
                .iter()
                .map(|color| color[axis])
                .fold((255, 0), |(lo, hi), v| (v.min(lo), v.max(hi)))
        };
        (0..3).map(|axis| (of(axis).1.saturating_sub(of(axis).0), axis)).max().unwrap_or_default()
    };
    let mut boxes = vec![(extent(pixels), pixels.to_vec())];
    while boxes.len() < count {
        let widest =
            (0..boxes.len()).max_by_key(|&i| boxes[i].0.0 as usize * boxes[i].1.len().isqrt());
        let Some(((_, axis), mut colors)) =
            widest.map(|i| boxes.swap_remove(i)).filter(|(extent, _)| extent.0 > 0)
        else {
            break;
        };
        colors.sort_unstable_by_key(|color| color[axis]);
        let middle = colors[colors.len() / 2][axis];
        let cut = colors.partition_point(|color| color[axis] < middle);
        let cut =
            if cut == 0 { colors.partition_point(|color| color[axis] <= middle) } else { cut };
        let upper = colors.split_off(cut);
        boxes.extend([colors, upper].map(|colors| (extent(&colors), colors)));
    }
    let mean = |colors: &[[u8; 3]]| {
        std::array::from_fn(|axis| {
            (colors.iter().map(|color| color[axis] as usize).sum::<usize>() / colors.len().max(1))
                as u8
        })
    };
    boxes.iter().map(|(_, colors)| mean(colors)).collect()
}

fn write_png(
    path: &str,
    [width, height]: [usize; 2],
    pixels: &[[u8; 3]],
    colors: Option<usize>,
) -> std::result::Result<(), String> {
    let failed = |error: &dyn std::fmt::Display| format!("cannot write {path}: {error}");
    let file = std::fs::File::create(path).map_err(|error| failed(&error))?;
    let mut encoder = png::Encoder::new(std::io::BufWriter::new(file), width as u32, height as u32);
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    encoder.set_compression(png::Compression::High);
    let bytes = match colors {
        None => {
            encoder.set_color(png::ColorType::Rgb);
            pixels.as_flattened().to_vec()
        }
        Some(count) => {
            let palette = palette(pixels, count);
            encoder.set_color(png::ColorType::Indexed);
            encoder.set_filter(png::Filter::NoFilter);
            encoder.set_palette(palette.as_flattened().to_vec());
            let off = |color: [u8; 3], pixel: [u8; 3]| {
                (0..3).map(|axis| (color[axis] as i32 - pixel[axis] as i32).pow(2)).sum::<i32>()
            };
            let nearest = |&pixel: &[u8; 3]| {
                (0..palette.len()).min_by_key(|&i| off(palette[i], pixel)).unwrap_or(0) as u8
            };
            pixels.par_iter().map(nearest).collect()
        }
    };
    let mut writer = encoder.write_header().map_err(|error| failed(&error))?;
    writer.write_image_data(&bytes).map_err(|error| failed(&error))?;
    writer.finish().map_err(|error| failed(&error))
}

/// A picture small enough to be committed.
fn reduce(drawn: &str, small: &str) -> std::result::Result<(), String> {
    let drawn = Picture::read(drawn)?;
    write_png(small, drawn.size, &side_by_side(&[&drawn])?, Some(96))
}

fn compare(drawn: &str, truth: &str, both: &str) -> std::result::Result<(), String> {
    let (drawn, truth) = (Picture::read(drawn)?, Picture::read(truth)?);
    if drawn.size != truth.size {
        return Err(format!("the pictures differ in size: {:?} and {:?}", drawn.size, truth.size));
    }
    let depth = drawn.channel("depth.Z")?;
    let truth_of = Truth::new(truth.channel("depth.Z")?, truth.size);
    let (solid, sky): (Vec<usize>, Vec<usize>) =
        (0..depth.len()).partition(|&pixel| truth_of.depth[pixel].is_finite());
    let drawn_in = |pixels: &[usize]| {
        pixels.iter().copied().filter(|&pixel| depth[pixel].is_finite()).collect::<Vec<_>>()
    };
    let (covered, in_the_sky) = (drawn_in(&solid), drawn_in(&sky));
    let inside: Vec<usize> =
        covered.par_iter().copied().filter(|&pixel| !truth_of.near_edge(pixel)).collect();
    let off = |pixel: usize| (depth[pixel] - truth_of.depth[pixel]).abs();
    let wrong_layer =
        inside.iter().filter(|&&pixel| off(pixel) > truth_of.tolerance(pixel)).count();
    let mut errors: Vec<f32> =
        inside.iter().map(|&pixel| off(pixel) / truth_of.depth[pixel]).collect();
    errors.sort_by(f32::total_cmp);
    let share = |part: usize, of: usize| {
        format!("{:6.2} %  {part} of {of}", 100.0 * part as f64 / of.max(1) as f64)
    };
    println!("pixels with a surface that got a point       {}", share(covered.len(), solid.len()));
    println!("pixels of empty sky that got a point         {}", share(in_the_sky.len(), sky.len()));
    println!("covered pixels away from edges               {}", share(inside.len(), covered.len()));
    println!("  of these on a wrong layer                  {}", share(wrong_layer, inside.len()));
    println!(
        "  relative depth error, median               {:6.4} %",
        100.0 * quantile(&errors, 0.5)
    );
    println!(
        "  relative depth error, 95th percentile      {:6.4} %",
        100.0 * quantile(&errors, 0.95)
    );
    write_png(both, [2 * drawn.size[0], drawn.size[1]], &side_by_side(&[&drawn, &truth])?, None)
}

fn main() -> std::process::ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let done = match &arguments[..] {
        [drawn, truth, both] => compare(drawn, truth, both),
        [drawn, small] => reduce(drawn, small),
        _ => Err("usage: compare DRAWN.exr TRUTH.exr SIDE_BY_SIDE.png, or compare DRAWN.exr FEW_COLOURS.png".to_string()),
    };
    match done {
        Ok(()) => std::process::ExitCode::SUCCESS,
        Err(why) => {
            eprintln!("compare: {why}");
            std::process::ExitCode::FAILURE
        }
    }
}
