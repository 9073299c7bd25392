//! Statistics of painting.

/// Statistics of painting, for `--explain`.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Facts {
    /// Strokes in the lists of tiles, once per tile; for z-buffered strokes all that were
    /// rasterised.
    pub listed: u64,
    /// Fragments in the A-buffer.
    pub fragments: u64,
    /// Fragments left out because another covers their pixel completely; no others are.
    pub hidden: u64,
    /// Largest number of fragments in one pixel.
    pub deepest: u32,
    /// Parts in which the picture was painted, because of the allowed memory.
    pub parts: u32,
    /// True if the device's binding limit was the bound, not the allowed memory.
    pub by_device: bool,
    /// Memory of the largest part.
    pub bytes: u64,
    /// Device time of counting beforehand `[ms]`.
    pub counting_ms: f64,
}

impl Facts {
    /// Returns the numbers that later frames report about a kept A-buffer.
    pub fn notes(&self) -> [u64; 5] {
        [self.listed, self.fragments, self.hidden, self.deepest as u64, self.bytes]
    }

    /// Returns a note if the picture was painted in parts.
    pub fn note(&self) -> Option<String> {
        let why = match self.by_device {
            true => "the device binds no more at once",
            false => "the memory allowed was reached; a larger --abuffer-memory needs fewer parts",
        };
        (self.parts > 1).then(|| {
            format!("painted in {} parts, because {why}; the picture is the same", self.parts)
        })
    }

    pub fn of([listed, fragments, hidden, deepest, bytes]: [u64; 5]) -> Facts {
        Facts {
            listed,
            fragments,
            hidden,
            deepest: deepest as u32,
            parts: 1,
            bytes,
            ..Facts::default()
        }
    }
}

impl std::fmt::Display for Facts {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Facts { listed, fragments, hidden, deepest, .. } = self;
        match fragments + hidden {
            0 => write!(f, "{listed} drawn, the nearest of each pixel")?,
            _ => write!(
                f,
                "{listed} in the lists of tiles; {fragments} fragments, at most {deepest} in a pixel; {hidden} left out, completely behind others"
            )?,
        }
        write!(
            f,
            "; {} MiB, {}",
            self.bytes.div_ceil(1 << 20),
            self.note().unwrap_or("all at once".into())
        )
    }
}
