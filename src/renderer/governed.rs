//! Pictures for a time or an error: the settings of the front that the governor has chosen.

use super::{Limit, RenderSettings, Renderer};
use crate::error::Result;
use crate::index::cache::CacheLocation;
use crate::select::lod::LodOptions;
use crate::tune::store::{Subject, switches};
use crate::tune::{Governor, Tuning};
use std::time::Duration;

impl Renderer {
    /// Sets the device time of a frame's pictures, or their error against those of the settings
    /// alone. Each frame is then drawn with the most accurate settings that fit, or the fastest
    /// that hold the error, by the front of `pointillist tune` in the user's cache folder, or else
    /// the program's own. Settings that you have changed stay. `None` draws with the settings
    /// alone.
    pub fn set_limit(&mut self, limit: Option<Limit>) -> Result<()> {
        self.revision += 1;
        let (Some(limit), Some(governor)) = (limit, &mut self.governor) else {
            self.governor = limit.map(|limit| self.new_governor(limit)).transpose()?;
            return Ok(());
        };
        governor.set_limit(limit);
        Ok(())
    }

    fn new_governor(&self, limit: Limit) -> Result<Governor> {
        let subject = Subject {
            device: self.gpu.device.name.clone(),
            driver: self.gpu.device.driver.clone(),
            is_cpu: self.gpu.device.is_cpu,
            switches: switches(&self.settings.effects),
            cloud: None,
        };
        let found = subject.find(&CacheLocation::user_folder()?)?;
        // A host's targets have all their pixels.
        Ok(Governor::new(&found.front.at_rest(), limit))
    }

    /// Returns the host's limits of cuts.
    fn cut(&self) -> LodOptions {
        LodOptions { budget: self.lod.budget.or(self.options.point_budget), ..self.lod }
    }

    /// Returns the settings of a picture of this size `[px]`, and the limits of its cut.
    pub(super) fn governed(&self, size: [u32; 2]) -> (RenderSettings, LodOptions) {
        let tuning = self.governor.as_ref().map_or(Tuning::usual(), Governor::tuning);
        tuning.applied(&self.settings, self.cut(), size)
    }

    /// Returns the limits of the cuts of a frame, by the size of a view `[px]`.
    pub(super) fn limits(&self) -> impl Fn([u32; 2]) -> LodOptions + use<> {
        let own = self.cut();
        let tuning = self.governor.as_ref().map_or(Tuning::usual(), Governor::tuning);
        move |size| tuning.applied(&RenderSettings::default(), own, size).1
    }

    /// Takes the time of a completed frame into account `[ms]`.
    pub(super) fn took(&mut self, place: usize, ms: f64) {
        let Some(governor) = &mut self.governor else { return };
        governor.after(place, Duration::from_secs_f64(ms / 1e3));
        // Pictures that are shown again follow, too.
        self.revision += u64::from(governor.place() != place);
    }
}
