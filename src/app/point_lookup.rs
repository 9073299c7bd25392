//! Looks up the record of a picked point in its file, on a thread, since files are long.

use super::{App, Event, print_line};
use crate::cloud::attribute::STATION_SHIFT;
use crate::cloud::point_lookup::{self, LookupQuery, Record};
use crate::error::{Error, Result};
use crate::resident::Point;
use glam::DVec3;

impl App {
    /// Forgets the picked points, and clicks that are not answered yet.
    pub(super) fn forget(&mut self) {
        self.clear_picked();
        self.mouse.early_picks.clear();
        self.mouse.pick_token.renew();
    }

    /// Clears the picked points.
    pub(super) fn clear_picked(&mut self) {
        self.ui.measure.points.clear();
        self.load.lookup_token.renew();
        if !self.load.active {
            self.ui.doing = None;
        }
    }

    pub(super) fn look_up(&mut self, point: &Point) {
        let station = point
            .kind
            .and_then(|kind| self.ui.categories.stations.get((kind >> STATION_SHIFT) as usize));
        let sought = LookupQuery {
            position: point.position,
            kind: point.kind.map(|kind| [kind as u8, (kind >> 8) as u8 & 15]),
            station: station.map(|station| (station.part, station.source)),
        };
        let (files, done, read) =
            (self.load.origins.clone(), self.events.clone(), self.options.opening.read);
        let token = self.load.lookup_token.clone();
        let watch = self.progress_reporter(token.clone());
        let work = move || {
            let looked = point_lookup::find(&files, read, &sought, &watch);
            drop(done.send_event(Event::LookedUp(sought.position, looked, token)));
        };
        match std::thread::Builder::new().name("point lookup".into()).spawn(work) {
            Ok(thread) => self.load.add_worker(thread),
            Err(error) => self.report_error(&Error::Request(format!(
                "cannot start a thread to look up a point: {error}"
            ))),
        }
    }

    pub(super) fn looked_up(&mut self, place: DVec3, looked: Result<Option<Record>>) {
        self.ui.doing = None;
        match looked {
            Ok(record) => {
                for number in self.ui.measure.found(place, &record) {
                    match &record {
                        Some(record) => print_line(&format!("record {number}: {record}")),
                        None => print_line(&format!(
                            "record {number}: none, since it is a sample that stands for several points"
                        )),
                    }
                }
            }
            Err(error) => self.report_error(&error),
        }
    }
}
