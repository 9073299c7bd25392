//! Fronts in the user's cache folder, beside the indexes, and those that the program brings.
//!
//! A front is of a device with its driver, of the effects that are switched on or off, and of a
//! cloud if one was measured. A file that cannot be read, or is of another version, is as good as
//! none: `tune` makes it again.

use super::front::Front;
use crate::atomic_file::write_atomically;
use crate::error::{Error, Result};
use crate::index::cache::CacheLocation;
use crate::passes::{Effects, Switch};
use std::path::{Path, PathBuf};

/// The program's own fronts: `pointillist tune` wrote them with `-o FILE.json`.
const SHIPPED: [&str; 2] =
    [include_str!("shipped/software.json"), include_str!("shipped/gpu.json")];

/// Returns the program's own front of a kind of device, or else of another kind.
fn shipped(is_cpu: bool) -> Result<Front> {
    let fronts: std::result::Result<Vec<Front>, _> =
        SHIPPED.iter().map(|text| serde_json::from_str(text)).collect();
    let mut fronts =
        fronts.map_err(|error| Error::Request(format!("the program's own fronts: {error}")))?;
    let place = fronts.iter().position(|front| front.is_cpu == is_cpu);
    Ok(fronts.swap_remove(place.unwrap_or(0)))
}

/// What a front is of.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Subject {
    pub device: String,
    pub driver: String,
    pub is_cpu: bool,
    /// Effects that are switched on or off, as after `--effect`.
    pub switches: String,
    /// Key of the files of a cloud.
    pub cloud: Option<String>,
}

/// A front, and where it is from.
pub struct Found {
    pub front: Front,
    pub origin: String,
}

/// Returns the effects that are switched on or off.
pub fn switches(effects: &Effects) -> String {
    let mut effects = effects.clone();
    let listed = effects.list();
    let words = listed.iter().filter_map(|listed| match listed.switch {
        Switch::Auto => None,
        Switch::On => Some(format!("{}=on", listed.effect.name())),
        Switch::Off => Some(format!("{}=off", listed.effect.name())),
    });
    words.collect::<Vec<_>>().join(" ")
}

impl Subject {
    fn file(&self, folder: &Path) -> PathBuf {
        let Subject { device, driver, switches, cloud, .. } = self;
        let key = blake3::hash(format!("{device}\n{driver}\n{switches}\n{cloud:?}").as_bytes());
        folder.join(format!("front-{}.json", &key.to_hex()[..16]))
    }

    /// Returns the front of this cloud, or else of any cloud, or else of devices of this kind.
    pub fn find(&self, place: &CacheLocation) -> Result<Found> {
        if let CacheLocation::Folder(folder) = place {
            for subject in [self.clone(), Subject { cloud: None, ..self.clone() }] {
                if let Some(front) = subject.read(folder) {
                    return Ok(Found { front, origin: subject.said() });
                }
            }
        }
        let front = shipped(self.is_cpu)?;
        let kind = if front.is_cpu { "a software device" } else { "a GPU" };
        let other = match self.switches.is_empty() {
            true => String::new(),
            false => format!(", without {}", self.switches),
        };
        let origin = format!(
            "the program's own front of {kind}, measured on {}{other}; `pointillist tune` measures this device",
            front.device
        );
        Ok(Found { front, origin })
    }

    fn said(&self) -> String {
        match &self.cloud {
            Some(_) => "the front of this cloud on this device".into(),
            None => "the front of this device".into(),
        }
    }

    fn read(&self, folder: &Path) -> Option<Front> {
        let text = std::fs::read_to_string(self.file(folder)).ok()?;
        let front: Front = serde_json::from_str(&text).ok()?;
        let known = front.tuned.iter().all(|tuned| tuned.tuning().is_some());
        (known && !front.tuned.is_empty()).then_some(front)
    }

    /// Keeps a front. Returns its file.
    pub fn keep(&self, place: &CacheLocation, front: &Front) -> Result<Option<PathBuf>> {
        let CacheLocation::Folder(folder) = place else { return Ok(None) };
        std::fs::create_dir_all(folder).map_err(|error| Error::io("create", folder, error))?;
        let path = self.file(folder);
        write(&path, front)?;
        Ok(Some(path))
    }
}

/// Writes a front to a file.
pub fn write(path: &Path, front: &Front) -> Result<()> {
    let text = serde_json::to_string_pretty(front)
        .map_err(|error| Error::format(path, error.to_string()))?;
    write_atomically(path, |partial| {
        std::fs::write(partial, format!("{text}\n"))
            .map_err(|error| Error::io("write", path, error))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn subject(switches: &str, cloud: Option<&str>) -> Subject {
        Subject {
            device: "llvmpipe".into(),
            driver: "Mesa".into(),
            is_cpu: true,
            switches: switches.into(),
            cloud: cloud.map(String::from),
        }
    }

    #[test]
    fn a_clouds_own_front_comes_before_the_devices_and_that_before_the_programs() {
        let folder = tempfile::tempdir().unwrap();
        let place = CacheLocation::Folder(folder.path().into());
        let shipped = subject("", None).find(&place).unwrap();
        assert!(shipped.origin.contains("program's own"), "{}", shipped.origin);
        let front = |device: &str| Front { device: device.into(), ..shipped.front.clone() };
        subject("", None).keep(&place, &front("any")).unwrap();
        subject("", Some("a")).keep(&place, &front("a")).unwrap();
        let found = |subject: Subject| subject.find(&place).unwrap().front.device;
        assert_eq!(found(subject("", Some("a"))), "a");
        assert_eq!(found(subject("", Some("b"))), "any");
        assert_eq!(found(subject("", None)), "any");
        assert_eq!(found(subject("ao=on", Some("a"))), shipped.front.device);
        // A damaged file is as good as none.
        std::fs::write(subject("", Some("a")).file(folder.path()), "{").unwrap();
        assert_eq!(found(subject("", Some("a"))), "any");
        assert_eq!(
            subject("", Some("a")).find(&CacheLocation::Temporary).unwrap().front,
            shipped.front
        );
    }

    #[test]
    fn the_programs_own_fronts_are_complete() {
        let software = shipped(true).unwrap();
        assert!(software.is_cpu);
        for text in SHIPPED {
            let front: Front = serde_json::from_str(text).unwrap();
            let tunings: Vec<_> = front.tuned.iter().map(|tuned| tuned.tuning().unwrap()).collect();
            for needed in [super::super::Tuning::usual(), super::super::Tuning::finest()] {
                assert!(tunings.contains(&needed), "{needed} is missing");
            }
            assert!(front.tuned.is_sorted_by(|a, b| a.ms[1] <= b.ms[1]));
        }
    }

    #[test]
    fn switches_are_those_that_are_not_automatic() {
        let mut effects = Effects::default();
        assert_eq!(switches(&effects), "");
        effects.set("ao=on").unwrap();
        effects.set("fill=off").unwrap();
        assert_eq!(switches(&effects), "fill=off ao=on");
    }
}
