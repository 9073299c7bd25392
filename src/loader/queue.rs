//! Request lists in, single requests out: the newest list wins.
//!
//! - post(list): requests of an older list that the newer one repeats stay, in the newer one's
//!   order; the rest is dropped
//! - next(): returns first what was dropped, so that it is answered, then the first request; waits
//!   if there is neither
//! - close(): nothing is returned any more
//!
//! The mutex is never held while a file is read, only while two lists are compared or a request is
//! taken. Each posted destination comes out once, started or dropped, or is dropped with the queue.
//!
//! `sync` is the standard library's; in `tests/queue.rs` it is loom's, which explores all
//! interleavings.

use super::sync::{Condvar, Mutex, MutexGuard};
use std::collections::{BTreeMap, VecDeque};

/// A requested node, in the order of the list.
pub struct NodeRequest<D> {
    pub node: usize,
    /// Number of position planes.
    pub planes: u32,
    /// `None` if an earlier list had it and no answer has come yet.
    pub destination: Option<D>,
}

/// Next task of the thread.
pub enum Next<D> {
    Read {
        node: usize,
        planes: u32,
        destination: D,
    },
    /// Not started before a newer list left it out.
    Dropped {
        node: usize,
        destination: D,
    },
}

struct Waiting<D> {
    requested: VecDeque<(usize, u32, D)>,
    dropped: VecDeque<(usize, D)>,
    closed: bool,
    /// True if the list is newer than the last look at it.
    is_new: bool,
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
                is_new: false,
            }),
            changed: Condvar::new(),
        }
    }

    /// Replaces the request list.
    pub fn post(&self, list: Vec<NodeRequest<D>>) {
        let mut waiting = self.lock();
        let older = std::mem::take(&mut waiting.requested).into_iter();
        let mut older: BTreeMap<usize, (u32, D)> =
            older.map(|(node, planes, destination)| (node, (planes, destination))).collect();
        for NodeRequest { node, planes, destination } in list {
            // Nothing to do if it has been started in the meantime.
            let found = destination.map(|own| (planes, own)).or_else(|| older.remove(&node));
            waiting
                .requested
                .extend(found.map(|(planes, destination)| (node, planes, destination)));
        }
        waiting
            .dropped
            .extend(older.into_iter().map(|(node, (_, destination))| (node, destination)));
        waiting.is_new = true;
        drop(waiting);
        self.changed.notify_one();
    }

    /// Returns the nodes of a list that was not looked at yet, and their numbers of planes.
    pub fn newest(&self) -> Option<Vec<(usize, u32)>> {
        let mut waiting = self.lock();
        std::mem::take(&mut waiting.is_new)
            .then(|| waiting.requested.iter().map(|(node, planes, _)| (*node, *planes)).collect())
    }

    /// Waits for the next task; `None` once closed.
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
