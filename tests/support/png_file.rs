//! PNG files, read back.

use std::path::Path;

pub struct Png {
    pub size: [u32; 2],
    pub pixels: Vec<[u8; 3]>,
}

pub fn read_png(path: &Path) -> Png {
    let file =
        std::fs::File::open(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let mut reader = png::Decoder::new(std::io::BufReader::new(file)).read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut bytes).unwrap();
    assert_eq!((info.color_type, info.bit_depth), (png::ColorType::Rgb, png::BitDepth::Eight));
    Png { size: [info.width, info.height], pixels: bytes.as_chunks::<3>().0.to_vec() }
}
