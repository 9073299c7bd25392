//! The first 30 bytes of layered points, of point formats 6 to 10.
//!
//! Every group of fields is a layer of its own, and every scanner channel has its own state, so
//! that the layer of GPS times cannot be decoded without the layer of coordinates, which says to
//! which channel a point belongs and whether its time changed. The `laz` crate decodes both in one
//! type, where a damaged file overflows the stack ([`super::times`]); this one takes its place.

use super::super::header::{array_at, u16_at, u32_at};
use super::times::Times;
use laz::decoders::ArithmeticDecoder;
use laz::decompressors::{IntegerDecompressor, IntegerDecompressorBuilder};
use laz::las::selective::DecompressionSelection;
use laz::models::{ArithmeticModel, ArithmeticModelBuilder};
use laz::record::LayeredFieldDecompressor;
use std::io::{Cursor, Error, ErrorKind, Read, Result, Seek, SeekFrom};

/// Bytes of the fields.
const BYTES: usize = 30;

type Decoder = ArithmeticDecoder<Cursor<Vec<u8>>>;

/// A group of fields, other than coordinates along x and y.
#[derive(Default)]
struct Layer {
    bytes: u32,
    is_wanted: bool,
    /// None where all points have the values of the first one, or these are not wanted.
    decoder: Option<Decoder>,
}

#[derive(Default)]
struct Layers {
    z: Layer,
    class: Layer,
    flags: Layer,
    intensity: Layer,
    scan_angle: Layer,
    user_data: Layer,
    source: Layer,
    time: Layer,
}

impl Layers {
    /// Returns the layers in the order of a chunk.
    fn in_order(&mut self) -> [&mut Layer; 8] {
        let Self { z, class, flags, intensity, scan_angle, user_data, source, time } = self;
        [z, class, flags, intensity, scan_angle, user_data, source, time]
    }
}

/// The decoder of one chunk.
pub struct Point14 {
    /// Version of the compression. In the third one, fields that follow are told the channel only
    /// where it changes.
    version: u16,
    /// The layer of x, y, returns, channels and changes, and its bytes.
    coordinates: Decoder,
    coordinate_bytes: u32,
    layers: Layers,
    channel: usize,
    /// `None` where the channel has no point yet.
    channels: [Option<Box<Channel>>; 4],
}

impl Point14 {
    pub fn new(version: u16) -> Self {
        Self {
            version,
            coordinates: decoder(Vec::new()),
            coordinate_bytes: 0,
            layers: Layers::default(),
            channel: 0,
            channels: Default::default(),
        }
    }
}

fn decoder(bytes: Vec<u8>) -> Decoder {
    ArithmeticDecoder::new(Cursor::new(bytes))
}

/// Reads a layer.
fn read(source: &mut impl Read, bytes: u32) -> Result<Decoder> {
    let mut layer = vec![0; bytes as usize];
    source.read_exact(&mut layer)?;
    let mut decoder = decoder(layer);
    decoder.read_init_bytes()?;
    Ok(decoder)
}

fn read_u32(source: &mut impl Read) -> Result<u32> {
    let mut bytes = [0; 4];
    source.read_exact(&mut bytes)?;
    Ok(u32::from_le_bytes(bytes))
}

/// The fields of a point.
#[derive(Clone)]
struct Fields {
    at: [i32; 3],
    intensity: u16,
    number: u8,
    returns: u8,
    /// Four flags of the class, two bits of the scanner channel, the scan's direction, and the edge
    /// of a flight line.
    flags: u8,
    class: u8,
    user_data: u8,
    scan_angle: i16,
    source: u16,
    time: i64,
}

impl Fields {
    fn of(bytes: &[u8]) -> Self {
        Self {
            at: [0, 4, 8].map(|k| u32_at(bytes, k) as i32),
            intensity: u16_at(bytes, 12),
            number: bytes[14] & 15,
            returns: bytes[14] >> 4,
            flags: bytes[15],
            class: bytes[16],
            user_data: bytes[17],
            scan_angle: u16_at(bytes, 18) as i16,
            source: u16_at(bytes, 20),
            time: i64::from_le_bytes(array_at(bytes, 22)),
        }
    }

    fn put(&self, bytes: &mut [u8]) {
        for (value, place) in self.at.iter().zip(bytes.chunks_exact_mut(4)) {
            place.copy_from_slice(&value.to_le_bytes());
        }
        bytes[12..14].copy_from_slice(&self.intensity.to_le_bytes());
        bytes[14] = self.returns << 4 | self.number;
        bytes[15] = self.flags;
        bytes[16] = self.class;
        bytes[17] = self.user_data;
        bytes[18..20].copy_from_slice(&self.scan_angle.to_le_bytes());
        bytes[20..22].copy_from_slice(&self.source.to_le_bytes());
        bytes[22..30].copy_from_slice(&self.time.to_le_bytes());
    }

    fn channel(&self) -> usize {
        (self.flags >> 4 & 3) as usize
    }

    fn set_channel(&mut self, channel: usize) {
        self.flags = self.flags & !0x30 | (channel as u8) << 4;
    }

    /// Returns flags without the channel.
    fn six_flags(&self) -> usize {
        (self.flags >> 6 << 4 | self.flags & 15) as usize
    }
}

/// A model that most files do not need.
type Rare = Option<ArithmeticModel>;

fn decode(decoder: &mut Decoder, rare: &mut Rare, symbols: u32) -> Result<u8> {
    let model = rare.get_or_insert_with(|| ArithmeticModelBuilder::new(symbols).build());
    Ok(decoder.decode_symbol(model)? as u8)
}

/// The state of a scanner channel.
struct Channel {
    last: Fields,
    /// Change of time from the point before the last to the last.
    has_new_time: bool,
    /// Differences along x and y, by the kind of return and whether the time changed.
    medians: [[Median; 2]; 12],
    /// Last heights, by the place of a return among those of its pulse.
    heights: [i32; 8],
    /// Last intensities, by the place of a return and whether the time changed.
    intensities: [u16; 8],
    times: Times,
    changes: [ArithmeticModel; 8],
    other_channel: ArithmeticModel,
    returns: [Rare; 16],
    number: [Rare; 16],
    number_of_same_time: ArithmeticModel,
    class: [Rare; 64],
    flags: [Rare; 64],
    user_data: [Rare; 64],
    numbers: Numbers,
}

/// The decoders of numbers.
struct Numbers {
    dx: IntegerDecompressor,
    dy: IntegerDecompressor,
    z: IntegerDecompressor,
    intensity: IntegerDecompressor,
    scan_angle: IntegerDecompressor,
    source: IntegerDecompressor,
}

impl Channel {
    /// Returns the state after a first point, or after one of another channel.
    fn after(last: &Fields) -> Self {
        let model = |symbols| ArithmeticModelBuilder::new(symbols).build();
        let number = |bits, contexts| {
            IntegerDecompressorBuilder::new().bits(bits).contexts(contexts).build_initialized()
        };
        Self {
            last: last.clone(),
            has_new_time: false,
            medians: [[Median::default(); 2]; 12],
            heights: [last.at[2]; 8],
            intensities: [last.intensity; 8],
            times: Times::layered(last.time),
            changes: std::array::from_fn(|_| model(128)),
            other_channel: model(3),
            returns: [const { None }; 16],
            number: [const { None }; 16],
            number_of_same_time: model(13),
            class: [const { None }; 64],
            flags: [const { None }; 64],
            user_data: [const { None }; 64],
            numbers: Numbers {
                dx: number(32, 2),
                dy: number(32, 22),
                z: number(32, 20),
                intensity: number(16, 4),
                scan_angle: number(16, 2),
                source: number(16, 1),
            },
        }
    }

    /// Decodes what changes in the next point: bits 0 and 1 for the number of the return, 2 for the
    /// number of returns, 3 for the scan angle, 4 for the time, 5 for the source, 6 for the
    /// channel.
    fn changes(&mut self, decoder: &mut Decoder) -> Result<u32> {
        let Fields { number, returns, .. } = self.last;
        let (is_first, is_last) = (number == 1, number >= returns);
        let kind = is_first as usize | (is_last as usize) << 1 | (self.has_new_time as usize) << 2;
        decoder.decode_symbol(&mut self.changes[kind])
    }

    /// Decodes the other fields of the next point.
    fn decode(
        &mut self,
        changes: u32,
        coordinates: &mut Decoder,
        layers: &mut Layers,
    ) -> Result<()> {
        let last = &mut self.last;
        let has_new_time = changes & 16 != 0;
        let [number, returns] = [last.number, last.returns].map(usize::from);
        if changes & 4 != 0 {
            last.returns = decode(coordinates, &mut self.returns[returns], 16)?;
        }
        last.number = match changes & 3 {
            0 => last.number,
            1 => (last.number + 1) % 16,
            2 => (last.number + 15) % 16,
            _ if has_new_time => decode(coordinates, &mut self.number[number], 16)?,
            _ => {
                let more = 2 + coordinates.decode_symbol(&mut self.number_of_same_time)? as u8;
                (last.number + more) % 16
            }
        };

        let is_single = last.returns == 1;
        let medians =
            &mut self.medians[kind(last.returns, last.number) << 1 | has_new_time as usize];
        let numbers = &mut self.numbers;
        let dx = numbers.dx.decompress(coordinates, medians[0].value(), is_single as u32)?;
        let context = is_single as u32 + (numbers.dx.k() & !1).min(20);
        let dy = numbers.dy.decompress(coordinates, medians[1].value(), context)?;
        for ((value, median), difference) in last.at.iter_mut().zip(medians).zip([dx, dy]) {
            *value = value.wrapping_add(difference);
            median.add(difference);
        }

        if let Some(decoder) = &mut layers.z.decoder {
            let k = (numbers.dx.k() + numbers.dy.k()) / 2;
            let context = (k - k % 2).min(18) + is_single as u32;
            let height = &mut self.heights[last.returns.abs_diff(last.number).min(7) as usize];
            *height = numbers.z.decompress(decoder, *height, context)?;
            last.at[2] = *height;
        }

        let (is_first, is_last) = (last.number == 1, last.number >= last.returns);
        if let Some(decoder) = &mut layers.class.decoder {
            let context = (last.class as usize & 31) << 1 | (is_first && is_last) as usize;
            last.class = decode(decoder, &mut self.class[context], 256)?;
        }
        if let Some(decoder) = &mut layers.flags.decoder {
            let flags = decode(decoder, &mut self.flags[last.six_flags()], 64)?;
            last.flags = flags >> 4 << 6 | last.flags & 0x30 | flags & 15;
        }
        if let Some(decoder) = &mut layers.intensity.decoder {
            let context = (is_first as usize) << 1 | is_last as usize;
            let intensity = &mut self.intensities[context << 1 | has_new_time as usize];
            let value =
                numbers.intensity.decompress(decoder, (*intensity).into(), context as u32)?;
            *intensity = value as u16;
            last.intensity = *intensity;
        }
        if let Some(decoder) = &mut layers.scan_angle.decoder
            && changes & 8 != 0
        {
            let before = last.scan_angle.into();
            last.scan_angle =
                numbers.scan_angle.decompress(decoder, before, has_new_time as u32)? as i16;
        }
        if let Some(decoder) = &mut layers.user_data.decoder {
            let model = &mut self.user_data[last.user_data as usize / 4];
            last.user_data = decode(decoder, model, 256)?;
        }
        if let Some(decoder) = &mut layers.source.decoder
            && changes & 32 != 0
        {
            last.source = numbers.source.decompress(decoder, last.source.into(), 0)? as u16;
        }
        if let Some(decoder) = &mut layers.time.decoder
            && has_new_time
        {
            last.time = self.times.next(decoder)?;
        }
        self.has_new_time = has_new_time;
        Ok(())
    }
}

/// Returns one of six kinds of returns. Zero returns, and returns beyond the number of all, are in
/// files that do not count them well.
fn kind(returns: u8, number: u8) -> usize {
    const WITH_ZERO: [usize; 16] = [0, 1, 2, 3, 4, 5, 3, 4, 4, 5, 5, 5, 5, 5, 5, 5];
    match (returns.min(number), returns.max(number)) {
        (0, more) => WITH_ZERO[more as usize],
        (1, 1) => 0,
        (1, 2) => 1,
        (2, 2) => 2,
        (1, _) | (2, 11..) => 3,
        (less, more) if less == more || (less >= 11 && more == less + 1) => 5,
        _ => 4,
    }
}

/// The middle of five numbers, of which a new one replaces by turns the largest and the smallest.
#[derive(Clone, Copy)]
struct Median {
    sorted: [i32; 5],
    replaces_largest: bool,
}

impl Default for Median {
    fn default() -> Self {
        Self { sorted: [0; 5], replaces_largest: true }
    }
}

impl Median {
    fn value(&self) -> i32 {
        self.sorted[2]
    }

    /// Adds a number. The turn ends with a number that is not on the side of the ones that stay.
    fn add(&mut self, value: i32) {
        let median = self.value();
        if self.replaces_largest {
            self.sorted[4] = value;
            self.replaces_largest = value < median;
        } else {
            self.sorted[0] = value;
            self.replaces_largest = value <= median;
        }
        self.sorted.sort_unstable();
    }
}

impl<R: Read + Seek> LayeredFieldDecompressor<R> for Point14 {
    fn size_of_field(&self) -> usize {
        BYTES
    }

    fn set_selection(&mut self, selection: DecompressionSelection) {
        let wanted = [
            selection.should_decompress_z(),
            selection.should_decompress_classification(),
            selection.should_decompress_flags(),
            selection.should_decompress_intensity(),
            selection.should_decompress_scan_angle(),
            selection.should_decompress_user_data(),
            selection.should_decompress_point_source_id(),
            selection.should_decompress_gps_time(),
        ];
        for (layer, is_wanted) in self.layers.in_order().into_iter().zip(wanted) {
            layer.is_wanted = is_wanted;
        }
    }

    fn init_first_point(
        &mut self,
        source: &mut R,
        first: &mut [u8],
        channel: &mut usize,
    ) -> Result<()> {
        source.read_exact(first)?;
        let fields = Fields::of(first);
        self.channel = fields.channel();
        *channel = self.channel;
        self.channels = Default::default();
        self.channels[self.channel] = Some(Box::new(Channel::after(&fields)));
        Ok(())
    }

    fn decompress_field_with(&mut self, bytes: &mut [u8], channel: &mut usize) -> Result<()> {
        let Some(mut present) = self.channels[self.channel].as_mut() else {
            return Err(Error::new(ErrorKind::InvalidData, "a chunk has no first point"));
        };
        let changes = present.changes(&mut self.coordinates)?;
        let has_new_channel = changes & 64 != 0;
        if has_new_channel {
            let more = 1 + self.coordinates.decode_symbol(&mut present.other_channel)? as usize;
            let before = present.last.clone();
            self.channel = (self.channel + more) % 4;
            present = self.channels[self.channel]
                .get_or_insert_with(|| Box::new(Channel::after(&before)));
            present.last.set_channel(self.channel);
        }
        if has_new_channel || self.version > 3 {
            *channel = self.channel;
        }
        present.decode(changes, &mut self.coordinates, &mut self.layers)?;
        present.last.put(bytes);
        Ok(())
    }

    fn read_layers_sizes(&mut self, source: &mut R) -> Result<()> {
        self.coordinate_bytes = read_u32(source)?;
        for layer in self.layers.in_order() {
            layer.bytes = read_u32(source)?;
        }
        Ok(())
    }

    fn read_layers(&mut self, source: &mut R) -> Result<()> {
        if self.coordinate_bytes > 0 {
            self.coordinates = read(source, self.coordinate_bytes)?;
        }
        for layer in self.layers.in_order() {
            if layer.is_wanted && layer.bytes > 0 {
                layer.decoder = Some(read(source, layer.bytes)?);
            } else {
                source.seek(SeekFrom::Current(layer.bytes.into()))?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use laz::LazVlr;
    use laz::record::{
        LayeredPointRecordCompressor, LayeredPointRecordDecompressor, RecordCompressor,
        RecordDecompressor,
    };

    /// Bytes of a record: those of [`Point14`], colours and near infrared, and two more.
    const RECORD: usize = BYTES + 8 + 2;

    /// Returns a laszip record for such points.
    fn laszip(version: u16) -> LazVlr {
        let mut bytes = [3u16, 0, 2, 0].map(u16::to_le_bytes).concat();
        bytes.extend([0u32, 50_000].map(u32::to_le_bytes).concat());
        bytes.extend([-1i64; 2].map(i64::to_le_bytes).concat());
        let items = [3, 10, BYTES as u16, version, 12, 8, version, 14, 2, version];
        bytes.extend(items.map(u16::to_le_bytes).concat());
        LazVlr::read_from(bytes.as_slice()).unwrap()
    }

    /// Returns records in which every field stays, steps, or becomes another, by turns often and
    /// seldom.
    fn records(seed: u64, count: usize) -> Vec<u8> {
        let mut state = seed;
        let mut random = |below: u64| {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 33) % below
        };
        let widths = [4, 4, 4, 2, 1, 1, 1, 1, 2, 2, 8, 2, 2, 2, 2, 1, 1];
        assert_eq!(widths.iter().sum::<usize>(), RECORD);
        let mut times = [0u64; 6].map(|_| random(1 << 31) << 32);
        let mut record = [0u8; RECORD];
        let mut all = Vec::new();
        for i in 0..count {
            let seldom = [2, 9, 60][i / 300 % 3];
            let mut at = 0;
            for width in widths {
                let field = &mut record[at..at + width];
                let mut value = [0; 8];
                value[..width].copy_from_slice(field);
                let value = u64::from_le_bytes(value);
                let next = match random(2 * seldom) {
                    0 => random(1 << 31) << 33 | random(1 << 31) << 2,
                    1 => random(4),
                    2 => value.wrapping_add(random(100)),
                    3 => value.wrapping_sub(random(100_000)),
                    _ => value,
                };
                field.copy_from_slice(&next.to_le_bytes()[..width]);
                at += width;
            }
            // Mostly times of a few clocks with their own steps.
            if random(4) > 0 {
                let clock = random(2 * seldom).min(5) as usize;
                times[clock] = times[clock].wrapping_add(700 * random(3) + random(2));
                record[22..30].copy_from_slice(&times[clock].to_le_bytes());
            }
            all.extend(record);
        }
        all
    }

    fn compressed(laszip: &LazVlr, records: &[u8]) -> Vec<u8> {
        let mut encoder = LayeredPointRecordCompressor::new(Cursor::new(Vec::new()));
        encoder.set_fields_from(laszip.items()).unwrap();
        encoder.compress_many(records).unwrap();
        encoder.done().unwrap();
        encoder.into_inner().into_inner()
    }

    #[test]
    fn fields_are_those_of_the_laz_crate() {
        for seed in 0..24u64 {
            let laszip = laszip(3 + seed as u16 % 2);
            let records = records(seed, 3000);
            let chunk = compressed(&laszip, &records);
            // All fields, then every one without some of the others.
            let some = [u32::MAX, 1 << (seed % 8), !(1 << (seed % 8)), 0];
            for selection in some.map(DecompressionSelection) {
                let mut ours = LayeredPointRecordDecompressor::new(Cursor::new(chunk.as_slice()));
                ours.add_field_decompressor(Point14::new(laszip.items()[0].version()));
                ours.set_fields_from(&laszip.items()[1..].to_vec()).unwrap();
                let mut theirs = LayeredPointRecordDecompressor::new(Cursor::new(chunk.as_slice()));
                theirs.set_fields_from(laszip.items()).unwrap();
                ours.set_selection(selection);
                theirs.set_selection(selection);
                for record in records.chunks_exact(RECORD) {
                    let [mut own, mut other] = [[0; RECORD]; 2];
                    ours.decompress_next(&mut own).unwrap();
                    theirs.decompress_next(&mut other).unwrap();
                    assert_eq!(own, other);
                    assert!(selection != DecompressionSelection::all() || own == record);
                }
            }
        }
    }

    #[test]
    fn kinds_of_returns_are_six() {
        let mut counts = [0; 6];
        (0..256).for_each(|both: u32| counts[kind(both as u8 >> 4, both as u8 & 15)] += 1);
        assert!(counts.iter().all(|count| *count > 0));
        assert_eq!([kind(1, 1), kind(2, 1), kind(2, 2), kind(3, 3), kind(12, 11)], [0, 1, 2, 5, 5]);
    }
}
