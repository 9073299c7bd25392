//! The next device after a lost one: the CPU's state goes on with it.

use super::{Host, PickId, PickedPoint, Renderer};
use crate::error::Result;
use crate::tune::Governor;

impl Renderer {
    /// Returns a renderer on another device, with the clouds, settings and filters of this one,
    /// such as after the loss of a device. Ids of clouds and picks stay the same.
    ///
    /// Files are read again. Clouds of points of the host's memory or buffers are in the state
    /// [`CloudState::Failed`](super::CloudState::Failed), to be removed and added again. Picks that
    /// have no answer yet meet nothing. Frames may be numbered from the beginning.
    ///
    /// # Errors
    /// If the device lacks what is required. This renderer stays as it is; it is dropped before the
    /// lost device is destroyed.
    ///
    /// # Safety
    /// As for [`Renderer::new`].
    pub unsafe fn restored(&self, host: &Host) -> Result<Renderer> {
        // SAFETY: as the caller ensures.
        let mut next = unsafe { Renderer::new(host, self.options) }?;
        next.settings = self.settings.clone();
        next.opacities = self.opacities.clone();
        next.clips = self.clips.clone();
        next.filter = self.filter.clone();
        next.lod = self.lod;
        next.scale = self.scale;
        next.set_limit(self.governor.as_ref().map(Governor::limit))?;
        (next.next_cloud, next.next_pick) = (self.next_cloud, self.next_pick);
        next.clouds = self.clouds.iter().map(|cloud| cloud.again()).collect::<Result<_>>()?;
        let wanted = self.wanted_picks.iter().map(|(pick, _)| *pick);
        let recorded = self.held.iter().flat_map(|held| held.picks());
        let unanswered = |pick: PickId| (pick, None::<PickedPoint>);
        next.answers = self.answers.clone();
        next.answers.extend(wanted.chain(recorded).map(unanswered));
        Ok(next)
    }
}
