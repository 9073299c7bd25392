//! Injected faults of the loader thread, for tests.

use std::str::FromStr;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FaultKind {
    /// Panic while a node is read.
    Panic,
    /// The read never ends.
    Hang,
    /// The read takes twice as long as is waited for without a word.
    Slow,
    /// The thread ends between two nodes.
    End,
}

/// A fault and its node: `panic:3` at the third node that a thread reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fault {
    how: FaultKind,
    node: u64,
}

impl Fault {
    /// Returns the fault at this node, counted from 1.
    pub fn at(&self, node: u64) -> Option<FaultKind> {
        (self.node == node).then_some(self.how)
    }
}

impl FromStr for Fault {
    type Err = String;

    fn from_str(text: &str) -> Result<Fault, String> {
        let (how, node) = text.split_once(':').unwrap_or_default();
        let how = match how {
            "panic" => Some(FaultKind::Panic),
            "hang" => Some(FaultKind::Hang),
            "slow" => Some(FaultKind::Slow),
            "end" => Some(FaultKind::End),
            _ => None,
        };
        let fault = how.and_then(|how| Some(Fault { how, node: node.parse().ok()? }));
        fault.ok_or(format!("{text:?} is not panic:N, hang:N, slow:N or end:N"))
    }
}
