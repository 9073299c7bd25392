//! PICKED POINT -> RECORD: what its file says of it, looked up by a thread, since files are long.

use super::{App, Event, tell};
use crate::cloud::attribute::STATION_SHIFT;
use crate::cloud::find::{self, Record, Sought};
use crate::error::{Error, Result};
use crate::resident::Point;
use glam::DVec3;

impl App {
    /// All that was picked.
    pub(super) fn forget(&mut self) {
        self.facts.measure.points.clear();
        self.lookup_token.renew();
        if !self.loading {
            self.facts.doing = None;
        }
    }

    pub(super) fn look_up(&mut self, point: &Point) {
        let station = point
            .kind
            .and_then(|kind| self.facts.categories.stations.get((kind >> STATION_SHIFT) as usize));
        let sought = Sought {
            position: point.position,
            kind: point.kind.map(|kind| [kind as u8, (kind >> 8) as u8 & 15]),
            station: station.map(|station| (station.part, station.source)),
        };
        let (files, done, read) =
            (self.origins.clone(), self.events.clone(), self.options.opening.read);
        let token = self.lookup_token.clone();
        let watch = self.watch(token.clone());
        let work = move || {
            let looked = find::find(&files, read, &sought, &watch);
            drop(done.send_event(Event::LookedUp(sought.position, looked, token)));
        };
        match std::thread::Builder::new().name("point lookup".into()).spawn(work) {
            Ok(thread) => self.workers.push(thread),
            Err(error) => self.trouble(&Error::Request(format!(
                "cannot start a thread to look a point up: {error}"
            ))),
        }
    }

    pub(super) fn looked_up(&mut self, place: DVec3, looked: Result<Option<Record>>) {
        self.facts.doing = None;
        match looked {
            Ok(record) => {
                for number in self.facts.measure.found(place, &record) {
                    match &record {
                        Some(record) => tell(&format!("record {number}: {record}")),
                        None => tell(&format!(
                            "record {number}: none, since it is a sample that stands for several points"
                        )),
                    }
                }
            }
            Err(error) => self.trouble(&error),
        }
    }
}
