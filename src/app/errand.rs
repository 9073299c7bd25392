//! Something long that a thread does for the window, which may stop waiting for it: what comes of it after that is nobody's.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

#[derive(Clone, Debug, Default)]
pub struct Errand(Arc<AtomicBool>);

impl Errand {
    /// Nobody waits for it any more.
    pub fn give_up(&self) {
        self.0.store(true, Relaxed);
    }

    pub fn is_given_up(&self) -> bool {
        self.0.load(Relaxed)
    }

    /// Another one in its place.
    pub fn renew(&mut self) -> Errand {
        self.give_up();
        *self = Errand::default();
        self.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whoever_works_on_an_errand_learns_that_another_one_has_taken_its_place() {
        let mut errand = Errand::default();
        let first = errand.renew();
        let worker = first.clone();
        assert!(!worker.is_given_up());
        let second = errand.renew();
        assert!(worker.is_given_up() && !second.is_given_up() && !errand.is_given_up());
    }
}
