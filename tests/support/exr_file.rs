//! EXR files, read back.

use std::collections::BTreeMap;
use std::path::Path;

pub struct Exr {
    pub size: [usize; 2],
    /// Bit patterns of the samples.
    pub layers: BTreeMap<String, Vec<u32>>,
}

impl Exr {
    pub fn floats(&self, name: &str) -> Vec<f32> {
        self.layers[name].iter().map(|&bits| f32::from_bits(bits)).collect()
    }
}

pub fn read_exr(path: &Path) -> Exr {
    use exr::prelude::{FlatSamples, read_first_flat_layer_from_file};
    let layer = read_first_flat_layer_from_file(path)
        .unwrap_or_else(|error| panic!("{}: {error}", path.display()))
        .layer_data;
    let bits = |samples| match samples {
        FlatSamples::F32(values) => values.into_iter().map(f32::to_bits).collect(),
        FlatSamples::U32(values) => values,
        FlatSamples::F16(_) => panic!("16-bit samples"),
    };
    let layers = layer
        .channel_data
        .list
        .into_iter()
        .map(|channel| (channel.name.to_string(), bits(channel.sample_data)))
        .collect();
    Exr { size: [layer.size.0, layer.size.1], layers }
}
