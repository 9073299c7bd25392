//! The loader's queue under all thread interleavings, explored by loom.
//!
//! The file itself is compiled here, with loom's mutex and condition variable.

use loom::model;
use loom::sync::Arc;
use loom::sync::atomic::{AtomicUsize, Ordering::SeqCst};
use loom::thread;
use queue::{Next, NodeRequest, Queue};

#[path = "../src/loader/queue.rs"]
mod queue;

mod sync {
    pub use loom::sync::{Condvar, Mutex, MutexGuard};
}

/// Destination of a node's pages; counted while it exists.
struct Place(Arc<AtomicUsize>);

impl Place {
    fn new(places: &Arc<AtomicUsize>) -> Place {
        places.fetch_add(1, SeqCst);
        Place(places.clone())
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        self.0.fetch_sub(1, SeqCst);
    }
}

type Shared = (Arc<Queue<Place>>, Arc<AtomicUsize>);

fn shared() -> Shared {
    (Arc::new(Queue::new()), Arc::new(AtomicUsize::new(0)))
}

fn new(node: usize, places: &Arc<AtomicUsize>) -> NodeRequest<Place> {
    NodeRequest { node, planes: 1, destination: Some(Place::new(places)) }
}

fn again(node: usize) -> NodeRequest<Place> {
    NodeRequest { node, planes: 2, destination: None }
}

/// Actions of the loader, in order.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Did {
    Read(usize),
    Dropped(usize),
}

fn does(next: Next<Place>) -> Did {
    match next {
        Next::Read { node, planes, destination } => {
            assert_eq!(planes, 1, "as many as its destination has room for");
            drop(destination);
            Did::Read(node)
        }
        Next::Dropped { node, destination } => {
            drop(destination);
            Did::Dropped(node)
        }
    }
}

/// A loader that answers a number of requests, and ends.
fn loader(queue: &Arc<Queue<Place>>, answers: usize) -> thread::JoinHandle<Vec<Did>> {
    let queue = queue.clone();
    thread::spawn(move || (0..answers).map(|_| does(queue.next().expect("it is open"))).collect())
}

#[test]
fn every_destination_is_answered_for_once_and_the_newest_list_wins() {
    model(|| {
        let (queue, places) = shared();
        let loader = loader(&queue, 4);
        queue.post(vec![new(1, &places), new(2, &places), new(3, &places)]);
        queue.post(vec![again(3), new(4, &places), again(1)]);
        let did = loader.join().unwrap();
        for node in 1..=4 {
            let answers = did
                .iter()
                .filter(|&&did| did == Did::Read(node) || did == Did::Dropped(node))
                .count();
            assert_eq!(answers, 1, "node {node}: {did:?}");
        }
        // First what was started before the second list came; then what that list drops, then the
        // rest of it in order.
        let orders: [&[Did]; 3] = [
            &[Did::Dropped(2), Did::Read(3), Did::Read(4), Did::Read(1)],
            &[Did::Read(1), Did::Dropped(2), Did::Read(3), Did::Read(4)],
            &[Did::Read(1), Did::Read(2), Did::Read(3), Did::Read(4)],
        ];
        assert!(orders.contains(&did.as_slice()), "{did:?}");
        assert_eq!(places.load(SeqCst), 0);
    });
}

#[test]
fn what_is_on_its_way_stays_within_its_bound() {
    const MOST: usize = 2;
    model(|| {
        let (queue, places) = shared();
        let loader = loader(&queue, 3);
        // A residency requests new destinations only if there is room, and repeated requests
        // without one.
        let mut left = vec![3, 2, 1];
        while let Some(&node) = left.last() {
            let on_their_way = places.load(SeqCst);
            assert!(on_their_way <= MOST);
            if on_their_way < MOST {
                left.pop();
                let kept = (1..node).map(again);
                queue.post(kept.chain([new(node, &places)]).collect());
            } else {
                thread::yield_now();
            }
        }
        assert_eq!(loader.join().unwrap(), [1, 2, 3].map(Did::Read));
        assert_eq!(places.load(SeqCst), 0);
    });
}

#[test]
fn closing_ends_the_loader_at_any_moment_and_leaves_nothing() {
    model(|| {
        let (queue, places) = shared();
        let loader = thread::spawn({
            let queue = queue.clone();
            move || while queue.next().map(does).is_some() {}
        });
        queue.post(vec![new(1, &places), new(2, &places)]);
        queue.post(vec![new(3, &places), again(2)]);
        queue.close();
        loader.join().unwrap();
        drop(queue);
        assert_eq!(places.load(SeqCst), 0);
    });
}

#[test]
fn two_who_post_at_once_lose_nothing() {
    model(|| {
        let (queue, places) = shared();
        let loader = loader(&queue, 2);
        let other = thread::spawn({
            let (queue, places) = (queue.clone(), places.clone());
            move || queue.post(vec![new(1, &places)])
        });
        queue.post(vec![new(2, &places)]);
        other.join().unwrap();
        assert_eq!(loader.join().unwrap().len(), 2);
        assert_eq!(places.load(SeqCst), 0);
    });
}

#[test]
fn a_list_is_looked_at_once() {
    model(|| {
        let (queue, places) = shared();
        queue.post(vec![new(1, &places)]);
        assert_eq!(queue.newest().map(|list| list.len()), Some(1));
        assert!(queue.newest().is_none());
    });
}
