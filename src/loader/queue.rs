//! WISH-LISTS in, one wish after another out: the newest list wins.
//!
//!   post(list): what an older list still waits for stays if the newer one names it, in the newer one's order; the rest is dropped
//!   next(): first what was dropped, so that somebody answers for it; then the first wish; where there is neither, waits
//!   close(): nothing comes out any more
//!
//! One mutex, which nobody holds while a file is read: whoever posts has it for as long as two lists are compared, whoever reads for as long as a wish is
//! taken. Each destination that is posted comes out once, begun or dropped, or is dropped with the queue.
//!
//! `sync` is the standard library's; in `tests/queue.rs` it is loom's, which goes through all orders in which threads can meet here.

use super::sync::{Condvar, Mutex, MutexGuard};
use std::collections::{BTreeMap, VecDeque};

/// A node that a frame wants, in the order of the list.
pub struct NodeRequest<D> {
    pub node: usize,
    /// Position planes.
    pub planes: u32,
    /// None where an earlier list brought it, and no answer has come yet.
    pub destination: Option<D>,
}

/// What is to be done next.
pub enum Next<D> {
    Read {
        node: usize,
        planes: u32,
        destination: D,
    },
    /// Not begun when a newer list no longer named it.
    Dropped {
        node: usize,
        destination: D,
    },
}

struct Waiting<D> {
    requested: VecDeque<(usize, u32, D)>,
    dropped: VecDeque<(usize, D)>,
    closed: bool,
}

pub struct Queue<D> {
    waiting: Mutex<Waiting<D>>,
    changed: Condvar,
}

impl<D> Queue<D> {
    pub fn new() -> Queue<D> {
        Queue {
            waiting: Mutex::new(Waiting {
                requested: VecDeque::new(),
                dropped: VecDeque::new(),
                closed: false,
            }),
            changed: Condvar::new(),
        }
    }

    /// Replaces the wish-list.
    pub fn post(&self, list: Vec<NodeRequest<D>>) {
        let mut waiting = self.lock();
        let older = std::mem::take(&mut waiting.requested).into_iter();
        let mut older: BTreeMap<usize, (u32, D)> =
            older.map(|(node, planes, destination)| (node, (planes, destination))).collect();
        for NodeRequest { node, planes, destination } in list {
            // Neither where it has been begun in the meantime.
            let found = destination.map(|own| (planes, own)).or_else(|| older.remove(&node));
            waiting
                .requested
                .extend(found.map(|(planes, destination)| (node, planes, destination)));
        }
        waiting
            .dropped
            .extend(older.into_iter().map(|(node, (_, destination))| (node, destination)));
        drop(waiting);
        self.changed.notify_one();
    }

    /// None once it is closed.
    pub fn next(&self) -> Option<Next<D>> {
        let mut waiting = self.lock();
        loop {
            if waiting.closed {
                return None;
            }
            if let Some((node, destination)) = waiting.dropped.pop_front() {
                return Some(Next::Dropped { node, destination });
            }
            if let Some((node, planes, destination)) = waiting.requested.pop_front() {
                return Some(Next::Read { node, planes, destination });
            }
            waiting = self.changed.wait(waiting).unwrap_or_else(|poisoned| poisoned.into_inner());
        }
    }

    pub fn close(&self) {
        self.lock().closed = true;
        self.changed.notify_one();
    }

    fn lock(&self) -> MutexGuard<'_, Waiting<D>> {
        self.waiting.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
    }
}
