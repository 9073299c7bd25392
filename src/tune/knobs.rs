//! The settings that trade accuracy for time, with their values.

use crate::passes::Effects;
use crate::render::settings::RenderSettings;
use crate::select::lod::LodOptions;

/// A setting that trades accuracy for time.
pub struct Knob {
    pub name: &'static str,
    /// Values, the most accurate first: as after `--effect`, or `lod` in pixels, or `budget` in
    /// points a pixel, or `resolution`, the divisor of both sides.
    pub values: &'static [&'static str],
    /// Place of the default among them.
    pub usual: u8,
}

/// All of them. Visibility and filling have no values finer than their defaults, which `study
/// visibility` and `study
/// fill` chose by the truth. A value names all that its knob sets, so that it replaces any other.
pub const KNOBS: [Knob; 14] = [
    Knob {
        name: "lod",
        values: &["lod=0", "lod=0.5", "lod=1", "lod=2", "lod=4", "lod=8"],
        usual: 2,
    },
    Knob {
        name: "budget",
        values: &["budget=all", "budget=16", "budget=4", "budget=1", "budget=0.25"],
        usual: 2,
    },
    Knob {
        name: "visibility",
        values: &[
            "visibility=auto,kernel=7,levels=10",
            "visibility=auto,kernel=7,levels=4",
            "visibility=auto,kernel=5,levels=10",
            "visibility=auto,kernel=5,levels=4",
            "visibility=auto,kernel=3,levels=10",
            "visibility=auto,kernel=3,levels=4",
            "visibility=auto,kernel=3,levels=2",
            "visibility=off,kernel=7,levels=10",
        ],
        usual: 0,
    },
    Knob {
        name: "fill",
        values: &[
            "fill=auto,levels=10",
            "fill=auto,levels=5",
            "fill=auto,levels=3",
            "fill=off,levels=10",
        ],
        usual: 0,
    },
    Knob { name: "scattered", values: &["scattered=auto", "scattered=off"], usual: 0 },
    Knob { name: "smooth", values: &["smooth=auto", "smooth=off"], usual: 0 },
    Knob { name: "antialias", values: &["antialias=auto", "antialias=off"], usual: 0 },
    Knob {
        name: "shape",
        values: &[
            "shape=auto,levels=64",
            "shape=auto,levels=32",
            "shape=auto,levels=16",
            "shape=auto,levels=8",
            "shape=auto,levels=4",
            "shape=auto,levels=2",
            "shape=auto,levels=1",
            "shape=off,levels=8",
        ],
        usual: 3,
    },
    Knob {
        name: "luminance",
        values: &[
            "luminance=auto,neighbourhood=0",
            "luminance=auto,neighbourhood=1",
            "luminance=off,neighbourhood=0",
        ],
        usual: 0,
    },
    Knob {
        name: "ao",
        values: &[
            "ao=directions=32,steps=16",
            "ao=directions=16,steps=8",
            "ao=directions=8,steps=4",
            "ao=directions=4,steps=4",
            "ao=directions=2,steps=4",
        ],
        usual: 2,
    },
    Knob {
        name: "shadows",
        values: &[
            "shadows=samples=64",
            "shadows=samples=16",
            "shadows=samples=4",
            "shadows=samples=1",
        ],
        usual: 3,
    },
    Knob {
        name: "strokes",
        values: &["strokes=blend=abuffer", "strokes=blend=blur", "strokes=blend=opaque"],
        usual: 0,
    },
    Knob {
        name: "transparency",
        values: &[
            "transparency=layers=64",
            "transparency=layers=16",
            "transparency=layers=8",
            "transparency=layers=4",
            "transparency=layers=2",
        ],
        usual: 1,
    },
    Knob {
        name: "resolution",
        values: &["resolution=1", "resolution=2", "resolution=3", "resolution=4"],
        usual: 0,
    },
];

/// A value of every knob.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Tuning([u8; KNOBS.len()]);

impl Tuning {
    /// Returns the program's defaults.
    pub fn usual() -> Tuning {
        Tuning(KNOBS.map(|knob| knob.usual))
    }

    /// Returns the most accurate tuning, which errors are measured against.
    pub fn finest() -> Tuning {
        Tuning([0; KNOBS.len()])
    }

    /// Returns the place of a knob's value.
    pub fn value(&self, knob: usize) -> usize {
        self.0[knob] as usize
    }

    /// Returns the tuning with another value of a knob.
    pub fn with(mut self, knob: usize, value: usize) -> Tuning {
        self.0[knob] = value.min(KNOBS[knob].values.len() - 1) as u8;
        self
    }

    /// Returns the divisor of a moving picture's sides. A picture at rest has all its pixels.
    pub fn divisor(&self) -> u32 {
        self.0.last().map_or(1, |value| *value as u32 + 1)
    }

    /// Tests whether no value is finer than the default: so are those of moving pictures, since a
    /// picture at rest has the defaults.
    pub fn is_no_finer(&self) -> bool {
        KNOBS.iter().zip(self.0).all(|(knob, value)| value >= knob.usual)
    }

    /// Returns the values that differ from the defaults.
    pub fn words(&self) -> Vec<String> {
        let values = KNOBS.iter().zip(self.0).filter(|(knob, value)| knob.usual != *value);
        values.map(|(knob, value)| knob.values[value as usize].to_string()).collect()
    }

    /// Parses what [`Tuning::words`] returns; `None` if a word is no value of a knob.
    pub fn of(words: &[String]) -> Option<Tuning> {
        words.iter().try_fold(Tuning::usual(), |tuning, word| {
            KNOBS.iter().enumerate().find_map(|(number, knob)| {
                let value = knob.values.iter().position(|value| value == word)?;
                Some(tuning.with(number, value))
            })
        })
    }

    /// Returns settings and limits of the cut with these values in place of defaults. What a user
    /// has set otherwise stays. `size` is that of the picture that is drawn `[px]`.
    pub fn applied(
        &self,
        asked: &RenderSettings,
        cut: LodOptions,
        size: [u32; 2],
    ) -> (RenderSettings, LodOptions) {
        let (mut settings, mut lod) = (asked.clone(), cut);
        for (knob, value) in KNOBS.iter().zip(self.0).filter(|(knob, value)| knob.usual != *value) {
            let text = knob.values[value as usize];
            match text.split_once('=') {
                Some(("lod", pixels)) => {
                    lod.lod_px = cut.lod_px.or(pixels.parse().ok());
                }
                Some(("budget", each)) => {
                    let pixels = size[0] as f64 * size[1] as f64;
                    let points = |each: f64| (each * pixels).ceil() as u64;
                    lod.budget = cut.budget.or(Some(each.parse().map_or(u64::MAX, points)));
                }
                Some(("resolution", _)) => {}
                _ if !is_usual(&asked.effects, knob) => {}
                _ => settings.effects.set_any(text).expect("a value of a knob"),
            }
        }
        (settings, lod)
    }
}

impl Knob {
    /// Returns the name of the effect that it sets; `None` if it sets the cut or the resolution.
    pub fn effect(&self) -> Option<&'static str> {
        let name = self.values[0].split('=').next()?;
        (!matches!(name, "lod" | "budget" | "resolution")).then_some(name)
    }
}

/// Tests whether effects have the default value of a knob.
fn is_usual(effects: &Effects, knob: &Knob) -> bool {
    let mut same = effects.clone();
    same.set_any(knob.values[knob.usual as usize]).expect("a value of a knob");
    same == *effects
}

impl std::fmt::Display for Tuning {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let words = self.words();
        if words.is_empty() { write!(f, "the default") } else { write!(f, "{}", words.join(" ")) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::select::lod::Detail;

    #[test]
    fn defaults_are_the_programs_own_and_every_value_is_one() {
        for knob in &KNOBS {
            assert!((knob.usual as usize) < knob.values.len(), "{}", knob.name);
            if knob.effect().is_some() {
                assert!(is_usual(&Effects::default(), knob), "{} has another default", knob.name);
                for value in knob.values {
                    Effects::default().set_any(value).unwrap();
                }
            }
        }
        let size = [1920, 1080];
        let explicit = LodOptions { budget: Some(4 * 1920 * 1080), lod_px: Some(1.0) };
        assert_eq!(explicit.of(size), Detail::of(size));
    }

    #[test]
    fn words_name_what_differs_and_are_read_back() {
        assert_eq!(Tuning::usual().words(), Vec::<String>::new());
        let tuning = Tuning::usual().with(0, 4).with(7, 6);
        assert_eq!(tuning.words(), ["lod=4", "shape=auto,levels=1"]);
        for tuning in [tuning, Tuning::usual(), Tuning::finest()] {
            assert_eq!(Tuning::of(&tuning.words()), Some(tuning));
        }
        assert_eq!(Tuning::of(&["shape=auto,levels=3".into()]), None);
        let small = Tuning::of(&["resolution=3".into()]).unwrap();
        assert_eq!((small.divisor(), Tuning::finest().divisor()), (3, 1));
    }

    #[test]
    fn what_a_user_has_set_stays() {
        let mut asked = RenderSettings::default();
        asked.effects.set("shape=levels=12").unwrap();
        let tuning = Tuning::usual().with(0, 4).with(1, 3).with(3, 3).with(7, 6);
        let mine = LodOptions { budget: None, lod_px: Some(3.0) };
        let (settings, lod) = tuning.applied(&asked, mine, [100, 50]);
        assert_eq!(lod, LodOptions { budget: Some(5000), lod_px: Some(3.0) });
        assert_eq!(settings.effects.shape, asked.effects.shape);
        assert_ne!(settings.effects.fill, asked.effects.fill);
        assert_eq!(Tuning::usual().applied(&asked, mine, [100, 50]), (asked, mine));
    }
}
