//! Cancellation of background work whose result the window no longer wants.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

/// A flag that the window and a worker share; results of cancelled work are dropped.
#[derive(Clone, Debug, Default)]
pub struct CancelToken(Arc<AtomicBool>);

impl CancelToken {
    /// Cancels the work; its result will be ignored.
    pub fn cancel(&self) {
        self.0.store(true, Relaxed);
    }

    pub fn is_cancelled(&self) -> bool {
        self.0.load(Relaxed)
    }

    /// Cancels the current work and returns the token of its replacement.
    pub fn renew(&mut self) -> CancelToken {
        self.cancel();
        *self = CancelToken::default();
        self.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn renew_cancels_the_previous_token() {
        let mut token = CancelToken::default();
        let first = token.renew();
        let worker = first.clone();
        assert!(!worker.is_cancelled());
        let second = token.renew();
        assert!(worker.is_cancelled() && !second.is_cancelled() && !token.is_cancelled());
    }
}
