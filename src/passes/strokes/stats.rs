//! What painting took, in numbers and in words.

/// What painting took, for `--explain`.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Facts {
    /// Strokes in the lists of tiles; one that touches two tiles counts twice. Of z-buffered strokes, which need none, all that went to the rasteriser.
    pub listed: u64,
    /// Of the A-buffer.
    pub fragments: u64,
    /// That are not in it, because they lie behind one that covers its pixel wholly; no others are left out.
    pub hidden: u64,
    /// In one pixel, at most.
    pub deepest: u32,
    /// In which the picture was painted, because all lists together would have been larger than the memory allowed.
    pub parts: u32,
    /// Not the memory allowed, but what the device binds at once is the bound.
    pub by_device: bool,
    /// Of the largest part.
    pub bytes: u64,
    /// On the device, of what was counted beforehand, milliseconds.
    pub counting_ms: f64,
}

impl Facts {
    /// Of an A-buffer that is kept, what later frames say of it.
    pub fn notes(&self) -> [u64; 5] {
        [self.listed, self.fragments, self.hidden, self.deepest as u64, self.bytes]
    }

    /// Where the memory allowed was reached, or the device's own bound.
    pub fn note(&self) -> Option<String> {
        let why = match self.by_device {
            true => "the device binds no more at once",
            false => "the memory allowed was reached; more, and fewer parts, with --abuffer-memory",
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
            0 => write!(f, "{listed} drawn, of each pixel the nearest")?,
            _ => write!(
                f,
                "{listed} in the lists of tiles; {fragments} fragments, {deepest} in a pixel at most, none left out but {hidden} wholly behind others"
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
