//! Something long that a thread does for the window, which may stop waiting for it: what comes of it after that is nobody's.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

#[derive(Clone, Debug, Default)]
pub struct CancelToken(Arc<AtomicBool>);

impl CancelToken {
    /// Nobody waits for it any more.
    pub fn cancel(&self) {
        self.0.store(true, Relaxed);
    }

    pub fn is_cancelled(&self) -> bool {
        self.0.load(Relaxed)
    }

    /// Another one in its place.
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
