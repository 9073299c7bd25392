//! An object on a server, read as a file is.

use super::blocks::{BLOCK, Blocks};
use super::store::{Answer, Client, Failure, Place};
use super::{STOPPED, cache};
use crate::error::{Error, Result};
use crate::progress::{Progress, Silent};
use bytes::Bytes;
use std::collections::{HashMap, VecDeque};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering::Relaxed;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Duration, Instant};

/// Blocks between two wanted ones that are requested with them: reading 256 KiB takes no longer
/// than another request.
const GAP: u64 = 4;

/// Most blocks of a request, 4 MiB: several of them at a time are faster than one.
const LONGEST: u64 = 64;

/// Blocks that stay in memory, 64 MiB: what was requested ahead, until it is read.
const IN_MEMORY: usize = 1024;

/// Time for which an object is believed to be as it was, and an error.
const FRESH: Duration = Duration::from_secs(30);
const FAILED: Duration = Duration::from_secs(5);

/// Longest wait between two looks at whether waiting makes sense.
const LOOK: Duration = Duration::from_millis(50);

/// Members that are requested ahead, and not asked for yet.
const MEMBERS: usize = 256;

/// An open object.
pub struct Object {
    path: PathBuf,
    length: u64,
    tag: String,
    place: Place,
    client: Arc<Client>,
    state: Mutex<State>,
    answered: Condvar,
    /// Files beside it or below it, requested ahead.
    members: Mutex<HashMap<PathBuf, Arc<Coming>>>,
}

struct State {
    /// Blocks on the disk; none if it cannot be written.
    disk: Option<Blocks>,
    recent: HashMap<u64, Bytes>,
    /// Blocks in memory, the oldest first.
    order: VecDeque<u64>,
    coming: HashMap<u64, Arc<Request>>,
    /// Blocks that did not come, and until when they are not requested again.
    failed: HashMap<u64, (Instant, Failure)>,
}

/// A request for adjacent blocks.
struct Request {
    blocks: Range<u64>,
    outcome: OnceLock<std::result::Result<Bytes, Failure>>,
}

/// A member that is being opened.
#[derive(Default)]
struct Coming {
    outcome: OnceLock<std::result::Result<Arc<Object>, Failure>>,
}

/// Objects that were opened, with the time.
type Opened = HashMap<PathBuf, (Instant, std::result::Result<Arc<Object>, Failure>)>;

static OPENED: Mutex<Option<Opened>> = Mutex::new(None);

fn ended() -> Failure {
    Failure::Wrong("is no longer needed".into())
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Lets go of objects that nothing uses, and of the threads if these were the last ones.
pub fn release() {
    let opened = lock(&OPENED).take();
    // Outside of the lock, since threads may end.
    drop(opened);
}

/// Waits for a future; errors if that makes no sense any more.
fn wait<T: Send + 'static>(
    client: &Client,
    future: impl Future<Output = T> + Send + 'static,
    look: &mut dyn FnMut() -> Result<()>,
) -> Result<T> {
    let (send, receive) = channel();
    client.spawn(async move { drop(send.send(future.await)) });
    loop {
        match receive.recv_timeout(LOOK) {
            Ok(value) => return Ok(value),
            Err(RecvTimeoutError::Timeout) if STOPPED.load(Relaxed) => {
                return Err(Error::Interrupted);
            }
            Err(RecvTimeoutError::Timeout) => look()?,
            Err(RecvTimeoutError::Disconnected) => {
                return Err(Error::Request("a thread that waits for servers has ended".into()));
            }
        }
    }
}

impl Object {
    /// Opens the object at an address. One that was opened a short time ago is the same.
    pub fn open(path: &Path, progress: &dyn Progress) -> Result<Arc<Object>> {
        Object::find(path, progress)?.map_err(|failure| Error::format(path, failure.to_string()))
    }

    /// Tests whether the server says that there is no such object.
    pub fn is_missing(path: &Path) -> bool {
        matches!(Object::find(path, &Silent), Ok(Err(Failure::Missing)))
    }

    fn find(
        path: &Path,
        progress: &dyn Progress,
    ) -> Result<std::result::Result<Arc<Object>, Failure>> {
        let mut before = None;
        if let Some((at, outcome)) = lock(&OPENED).as_ref().and_then(|opened| opened.get(path)) {
            if at.elapsed() < if outcome.is_ok() { FRESH } else { FAILED } {
                return Ok(outcome.clone());
            }
            before = outcome.clone().ok();
        }
        let doing = format!("opening {}", super::without_query(path).display());
        progress.tick(&doing, 0, 0)?;
        let address = path.to_str().unwrap_or_default().to_string();
        let client = Client::shared()?;
        let servers = client.servers.clone();
        let first = async move {
            let place = Place::of(&servers, &address).await?;
            let answer = place.get(0..BLOCK).await;
            Ok::<_, Failure>((place, answer))
        };
        let outcome = match wait(&client, first, &mut || progress.tick(&doing, 0, 0))? {
            Ok((place, Ok(answer))) => {
                let same =
                    before.filter(|own| (own.length, &own.tag) == (answer.length, &answer.tag));
                Ok(same.unwrap_or_else(|| Object::begun(path, None, place, client, answer)))
            }
            Ok((place, Err(Failure::NoRanges))) => Object::whole(path, place, client, progress)?,
            Ok((_, Err(failure))) | Err(failure) => Err(failure),
        };
        let mut opened = lock(&OPENED);
        let opened = opened.get_or_insert_default();
        opened.retain(|_, (at, _)| at.elapsed() < FRESH);
        opened.insert(path.to_owned(), (Instant::now(), outcome.clone()));
        Ok(outcome)
    }

    fn new(
        path: &Path,
        place: Place,
        client: Arc<Client>,
        disk: Option<Blocks>,
        length: u64,
        tag: String,
    ) -> Object {
        let state = State {
            disk,
            recent: HashMap::new(),
            order: VecDeque::new(),
            coming: HashMap::new(),
            failed: HashMap::new(),
        };
        Object {
            path: path.to_owned(),
            length,
            tag,
            place,
            client,
            state: Mutex::new(state),
            answered: Condvar::new(),
            members: Mutex::default(),
        }
    }

    /// Returns the object whose first bytes are these.
    fn begun(
        path: &Path,
        key: Option<&str>,
        place: Place,
        client: Arc<Client>,
        answer: Answer,
    ) -> Arc<Object> {
        let Answer { bytes, length, tag } = answer;
        let own = key.map_or_else(|| key_of(path), str::to_string);
        let disk = Blocks::create(&own, length, &tag).ok();
        let object = Object::new(path, place, client, disk, length, tag);
        object.keep(&mut lock(&object.state), 0, &bytes);
        Arc::new(object)
    }

    /// Fetches the object of a server that gives no parts.
    fn whole(
        path: &Path,
        place: Place,
        client: Arc<Client>,
        progress: &dyn Progress,
    ) -> Result<std::result::Result<Arc<Object>, Failure>> {
        let name = super::without_query(path).display().to_string();
        progress
            .note(&format!("{name}: its server gives no parts of files, so it is fetched whole"));
        let doing = format!("fetching {name}");
        let done = Arc::new(Mutex::new([0u64; 2]));
        let (own, count) = (path.to_owned(), done.clone());
        let weak = Arc::downgrade(&client);
        let fetched = async move {
            let (from, key) = (place.clone(), key_of(&own));
            let begin = |length: u64, tag: String| {
                fits(length)?;
                let disk = Blocks::create(&key, length, &tag).map_err(unwritable)?;
                Ok((disk, length, tag, Vec::new(), 0))
            };
            let take = |state: &mut (Blocks, u64, String, Vec<u8>, u64), bytes: Bytes| {
                let (disk, length, _, rest, block) = state;
                rest.extend_from_slice(&bytes);
                let whole = rest.len() as u64 / BLOCK * BLOCK;
                let is_end = *block * BLOCK + rest.len() as u64 == *length;
                let ready = if is_end { rest.len() } else { whole as usize };
                for bytes in rest[..ready].chunks(BLOCK as usize) {
                    disk.write(*block, bytes).map_err(unwritable)?;
                    *block += 1;
                }
                rest.drain(..ready);
                *lock(&count) = [*block * BLOCK, *length];
                Ok(())
            };
            let (disk, length, tag, ..) = from.get_all(begin, take).await?;
            let client = weak.upgrade().ok_or_else(ended)?;
            Ok(Arc::new(Object::new(&own, place, client, Some(disk), length, tag)))
        };
        wait(&client, fetched, &mut || {
            let [done, total] = *lock(&done);
            progress.tick(&doing, done.min(total), total)
        })
    }

    pub fn length(&self) -> u64 {
        self.length
    }

    /// Returns what tells this version of the object from others.
    pub fn tag(&self) -> &str {
        &self.tag
    }

    fn wrong(&self, failure: &Failure) -> Error {
        Error::format(&self.path, failure.to_string())
    }

    fn bytes_of(&self, block: u64) -> usize {
        (self.length - block * BLOCK).min(BLOCK) as usize
    }

    /// Fills `into` from `offset`, less at the end. Returns the number of bytes.
    pub fn read_at(self: &Arc<Object>, offset: u64, into: &mut [u8]) -> Result<usize> {
        let end = offset.saturating_add(into.len() as u64).min(self.length);
        if offset >= end {
            return Ok(0);
        }
        let all = offset..end;
        if into.len() as u64 > BLOCK {
            self.ahead(std::slice::from_ref(&all));
        }
        for block in offset / BLOCK..end.div_ceil(BLOCK) {
            let bytes = self.block(block)?;
            let own = block * BLOCK..block * BLOCK + bytes.len() as u64;
            let (from, to) = (own.start.max(offset), own.end.min(end));
            into[(from - offset) as usize..(to - offset) as usize]
                .copy_from_slice(&bytes[(from - own.start) as usize..(to - own.start) as usize]);
        }
        Ok((end - offset) as usize)
    }

    /// Returns a block, as soon as it is there.
    fn block(self: &Arc<Object>, block: u64) -> Result<Bytes> {
        let mut state = lock(&self.state);
        if let Some(bytes) = state.found(block, self.bytes_of(block)) {
            return Ok(bytes);
        }
        let request = match state.coming.get(&block) {
            Some(request) => request.clone(),
            None => match state.failure(block) {
                Some(failure) => return Err(self.wrong(&failure)),
                None => self.request(&mut state, block..block + 1),
            },
        };
        loop {
            match request.outcome.get() {
                Some(Ok(bytes)) => {
                    let from = ((block - request.blocks.start) * BLOCK) as usize;
                    return Ok(bytes.slice(from..from + self.bytes_of(block)));
                }
                Some(Err(failure)) => return Err(self.wrong(failure)),
                None if STOPPED.load(Relaxed) => return Err(Error::Interrupted),
                None => {
                    let waited = self.answered.wait_timeout(state, LOOK);
                    state = waited.unwrap_or_else(PoisonError::into_inner).0;
                }
            }
        }
    }

    /// Requests what is missing of these ranges, without waiting.
    pub fn ahead(self: &Arc<Object>, ranges: &[Range<u64>]) {
        let mut state = lock(&self.state);
        let ends =
            |range: &Range<u64>| range.start / BLOCK..range.end.min(self.length).div_ceil(BLOCK);
        let mut blocks: Vec<u64> = ranges.iter().flat_map(ends).collect();
        blocks.sort_unstable();
        blocks.dedup();
        blocks.retain(|&block| {
            !state.has(block, self.bytes_of(block)) && state.failure(block).is_none()
        });
        for run in blocks.chunk_by(|a, b| b - a <= GAP + 1) {
            let (first, end) = (run[0], run[run.len() - 1] + 1);
            for start in (first..end).step_by(LONGEST as usize) {
                self.request(&mut state, start..end.min(start + LONGEST));
            }
        }
    }

    /// Requests adjacent blocks.
    fn request(self: &Arc<Object>, state: &mut State, blocks: Range<u64>) -> Arc<Request> {
        let request = Arc::new(Request { blocks: blocks.clone(), outcome: OnceLock::new() });
        blocks.clone().for_each(|block| drop(state.coming.insert(block, request.clone())));
        let (object, place, own) = (Arc::downgrade(self), self.place.clone(), request.clone());
        let range = blocks.start * BLOCK..(blocks.end * BLOCK).min(self.length);
        self.client.spawn(async move {
            let answer = place.get(range).await;
            if let Some(object) = object.upgrade() {
                object.take(&own, answer);
            }
        });
        request
    }

    /// Takes the answer to a request.
    fn take(&self, request: &Request, answer: std::result::Result<Answer, Failure>) {
        let is_same = |own: &Answer| (own.length, &own.tag) == (self.length, &self.tag);
        let outcome = answer.and_then(|answer| match is_same(&answer) {
            true => Ok(answer.bytes),
            false => Err(Failure::Wrong(
                "has changed on its server since it was opened; open it again".into(),
            )),
        });
        let mut state = lock(&self.state);
        match &outcome {
            Ok(bytes) => self.keep(&mut state, request.blocks.start, bytes),
            Err(failure) => {
                let until = Instant::now() + FAILED;
                let failed = request.blocks.clone().map(|block| (block, (until, failure.clone())));
                state.failed.extend(failed);
            }
        }
        let is_own = |own: &Arc<Request>| std::ptr::eq(Arc::as_ptr(own), request);
        state.coming.retain(|_, own| !is_own(own));
        // Set once, here.
        let _ = request.outcome.set(outcome);
        drop(state);
        self.answered.notify_all();
    }

    /// Keeps bytes from the beginning of a block on.
    fn keep(&self, state: &mut State, first: u64, bytes: &Bytes) {
        for (start, block) in (0..bytes.len()).step_by(BLOCK as usize).zip(first..) {
            let own = bytes.slice(start..(start + BLOCK as usize).min(bytes.len()));
            if own.len() != self.bytes_of(block) {
                break;
            }
            // A full disk costs time, and nothing else.
            if state.disk.as_mut().is_some_and(|disk| disk.write(block, &own).is_err()) {
                state.disk = None;
            }
            state.hold(block, own);
        }
    }

    /// Fetches all that is missing to the disk.
    pub fn download(self: &Arc<Object>, name: &str, progress: &dyn Progress) -> Result<()> {
        fits(self.length).map_err(|failure| self.wrong(&failure))?;
        let doing = format!("fetching {name}");
        let step = LONGEST * BLOCK;
        let mut part = vec![0; step as usize];
        for at in (0..self.length).step_by(step as usize) {
            progress.tick(&doing, at, self.length)?;
            self.ahead(std::slice::from_ref(&(at..at + 8 * step)));
            self.read_at(at, &mut part)?;
        }
        progress.tick(&doing, self.length, self.length)
    }

    /// Opens a file that belongs to this one. What is known of it is known with this version.
    pub fn member(&self, path: &Path) -> Result<Arc<Object>> {
        let failed = |failure: &Failure| Error::format(path, failure.to_string());
        self.members_ahead(&[path.to_owned()]);
        let Some(coming) = lock(&self.members).get(path).cloned() else {
            return Err(failed(&Failure::Wrong("was given up".into())));
        };
        let begun = Instant::now();
        let mut pause = Duration::from_micros(100);
        let outcome = loop {
            match coming.outcome.get() {
                Some(outcome) => break outcome.clone(),
                None if STOPPED.load(Relaxed) => return Err(Error::Interrupted),
                None => std::thread::sleep(pause),
            }
            pause = if begun.elapsed() > LOOK { LOOK / 10 } else { pause };
        };
        lock(&self.members).remove(path);
        outcome.map_err(|failure| failed(&failure))
    }

    /// Requests members, without waiting.
    pub fn members_ahead(&self, paths: &[PathBuf]) {
        let mut members = lock(&self.members);
        if members.len() > MEMBERS {
            // These are not requested yet, and may never be.
            members.retain(|_, coming| coming.outcome.get().is_none());
        }
        for path in paths {
            if members.contains_key(path) {
                continue;
            }
            let coming = Arc::<Coming>::default();
            members.insert(path.clone(), coming.clone());
            let (path, key) = (path.clone(), format!("{} {}", key_of(path), self.tag));
            let (servers, weak) = (self.client.servers.clone(), Arc::downgrade(&self.client));
            self.client.spawn(async move {
                let opened = async {
                    let place = Place::of(&servers, path.to_str().unwrap_or_default()).await?;
                    let client = || weak.upgrade().ok_or_else(ended);
                    if let Some((disk, length, tag)) = Blocks::find(&key) {
                        let object = Object::new(&path, place, client()?, Some(disk), length, tag);
                        return Ok(Arc::new(object));
                    }
                    let answer = place.get(0..LONGEST * BLOCK).await?;
                    Ok(Object::begun(&path, Some(&key), place, client()?, answer))
                };
                let _ = coming.outcome.set(opened.await);
            });
        }
    }
}

impl State {
    /// Returns why a block did not come a short time ago.
    fn failure(&mut self, block: u64) -> Option<Failure> {
        let now = Instant::now();
        self.failed.get(&block).filter(|(until, _)| *until > now).map(|(_, why)| why.clone())
    }

    /// Tests whether a block need not be requested.
    fn has(&mut self, block: u64, bytes: usize) -> bool {
        self.coming.contains_key(&block)
            || self.recent.contains_key(&block)
            || self.disk.as_mut().is_some_and(|disk| disk.has(block, bytes))
    }

    /// Returns a block that is in memory or on the disk.
    fn found(&mut self, block: u64, bytes: usize) -> Option<Bytes> {
        if let Some(found) = self.recent.get(&block) {
            return Some(found.clone());
        }
        let found = Bytes::from(self.disk.as_mut()?.read(block, bytes)?);
        self.hold(block, found.clone());
        Some(found)
    }

    /// Keeps a block in memory, in place of the oldest ones.
    fn hold(&mut self, block: u64, bytes: Bytes) {
        if self.recent.insert(block, bytes).is_none() {
            self.order.push_back(block);
        }
        while self.order.len() > IN_MEMORY
            && let Some(oldest) = self.order.pop_front()
        {
            self.recent.remove(&oldest);
        }
    }
}

/// Returns what an object's file on the disk is named by.
fn key_of(path: &Path) -> String {
    super::without_query(path).display().to_string()
}

/// Errors if the cache has no room for an object as a whole.
fn fits(length: u64) -> std::result::Result<(), Failure> {
    let most = cache().most;
    if length <= most {
        return Ok(());
    }
    Err(Failure::Wrong(format!(
        "has {length} bytes and would be fetched whole, but the cache holds {most}: give --cache-size, or make a COPC file of it (`pointillist export FILE -o NAME.copc.laz`), of which only parts are fetched"
    )))
}

fn unwritable(error: std::io::Error) -> Failure {
    Failure::Wrong(format!("cannot be kept in the cache: {error}; give --cache-dir"))
}
