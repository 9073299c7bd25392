//! Servers, by the `object_store` crate: whose object an address is, requests, and what answers
//! mean.
//!
//! Credentials are those of the environment, by the names that each service's own tools use.
//! Without any, requests are not signed, as public buckets want them.

use super::{BYTES, REQUESTS};
use crate::error::Error;
use object_store::aws::{AmazonS3Builder, resolve_bucket_region};
use object_store::azure::MicrosoftAzureBuilder;
use object_store::gcp::GoogleCloudStorageBuilder;
use object_store::http::HttpBuilder;
use object_store::path::Path as Location;
use object_store::{
    BackoffConfig, ClientOptions, GetOptions, GetRange, GetResult, ObjectStore, RetryConfig,
};
use std::collections::HashMap;
use std::ops::Range;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::time::Duration;
use tokio::runtime::Runtime;
use tokio::sync::Semaphore;
use url::Url;

/// Requests at a time. At 50 ms each, this many of half a megabyte are 160 MB/s.
const AT_ONCE: usize = 16;

/// Longest wait for a connection, and for the next bytes of an answer.
const CONNECT: Duration = Duration::from_secs(5);
const NEXT_BYTES: Duration = Duration::from_secs(10);

/// Most tries after the first, and the time after which none is made. A server that is busy for two
/// seconds is no error.
const RETRIES: usize = 5;
const RETRYING: Duration = Duration::from_secs(15);

static AT_A_TIME: Semaphore = Semaphore::const_new(AT_ONCE);

/// Servers by the beginnings of addresses, so that connections to each are used again.
#[derive(Clone, Default)]
pub struct Servers(Arc<Mutex<HashMap<String, Arc<dyn ObjectStore>>>>);

/// Threads that wait for servers, and these. They end with the last object: what they run holds
/// neither it nor this.
pub struct Client {
    runtime: Option<Runtime>,
    pub servers: Servers,
}

static CLIENT: Mutex<Weak<Client>> = Mutex::new(Weak::new());

/// Longest wait for threads to end.
const END: Duration = Duration::from_millis(500);

impl Client {
    /// Returns the process's only one, which it starts if there is none.
    pub fn shared() -> Result<Arc<Client>, Error> {
        let mut shared = CLIENT.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(client) = shared.upgrade() {
            return Ok(client);
        }
        // An error means that there is one already.
        let _ = rustls::crypto::ring::default_provider().install_default();
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(2)
            .thread_name("network")
            .enable_all()
            .build()
            .map_err(|error| {
                Error::Request(format!("cannot start threads that wait for servers: {error}"))
            })?;
        let client = Arc::new(Client { runtime: Some(runtime), servers: Servers::default() });
        *shared = Arc::downgrade(&client);
        Ok(client)
    }

    /// Runs a future on the threads.
    pub fn spawn(&self, future: impl Future<Output = ()> + Send + 'static) {
        self.runtime.as_ref().expect("taken by the end only").spawn(future);
    }
}

impl Drop for Client {
    fn drop(&mut self) {
        let Some(runtime) = self.runtime.take() else { return };
        // One of its own threads, which holds the last object, cannot wait for itself.
        match tokio::runtime::Handle::try_current() {
            Ok(_) => runtime.shutdown_background(),
            Err(_) => runtime.shutdown_timeout(END),
        }
    }
}

/// An object on a server.
#[derive(Clone)]
pub struct Place {
    server: Arc<dyn ObjectStore>,
    location: Location,
}

/// An answer to a request for bytes.
pub struct Answer {
    pub bytes: bytes::Bytes,
    /// Length and tag of the whole object.
    pub length: u64,
    pub tag: String,
}

/// Why there is no answer.
#[derive(Clone, Debug)]
pub enum Failure {
    /// There is no such object.
    Missing,
    /// The server gives no parts of objects.
    NoRanges,
    /// What is wrong, to follow the address.
    Wrong(String),
}

impl std::fmt::Display for Failure {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Failure::Missing => f.write_str("is not there (404)"),
            Failure::NoRanges => f.write_str("is on a server that gives no parts of files"),
            Failure::Wrong(what) => f.write_str(what),
        }
    }
}

impl Place {
    /// Finds the server of an address. It is asked nothing yet, except for a bucket's region.
    pub async fn of(servers: &Servers, address: &str) -> Result<Place, Failure> {
        let wrong =
            |what: String| Failure::Wrong(format!("is no address that can be read: {what}"));
        let url = Url::parse(address).map_err(|error| wrong(error.to_string()))?;
        let location =
            Location::from_url_path(url.path()).map_err(|error| wrong(error.to_string()))?;
        let mut base = url.clone();
        base.set_path("");
        base.set_fragment(None);
        let lock = || servers.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(server) = lock().get(base.as_str()) {
            return Ok(Place { server: server.clone(), location });
        }
        let server = server(&base).await.map_err(|error| wrong(last_cause(&error)))?;
        lock().insert(base.into(), server.clone());
        Ok(Place { server, location })
    }

    /// Requests some bytes, fewer at the end of the object.
    pub async fn get(&self, range: Range<u64>) -> Result<Answer, Failure> {
        let _one = AT_A_TIME.acquire().await;
        let options =
            GetOptions { range: Some(GetRange::Bounded(range.clone())), ..GetOptions::default() };
        let result = self.server.get_opts(&self.location, options).await;
        REQUESTS.fetch_add(1, Relaxed);
        let result = result.map_err(failure)?;
        let (length, tag) = (result.meta.size, tag(&result));
        let bytes = result.bytes().await.map_err(failure)?;
        BYTES.fetch_add(bytes.len() as u64, Relaxed);
        let expected = range.end.min(length).saturating_sub(range.start);
        if bytes.len() as u64 != expected {
            return Err(Failure::Wrong(format!(
                "has a server that sent {} of {expected} bytes from byte {} on",
                bytes.len(),
                range.start
            )));
        }
        Ok(Answer { bytes, length, tag })
    }

    /// Requests all bytes. Calls `begin` with length and tag, then `take` with parts in order.
    pub async fn get_all<T>(
        &self,
        begin: impl FnOnce(u64, String) -> Result<T, Failure>,
        mut take: impl FnMut(&mut T, bytes::Bytes) -> Result<(), Failure>,
    ) -> Result<T, Failure> {
        let _one = AT_A_TIME.acquire().await;
        let result = self.server.get_opts(&self.location, GetOptions::default()).await;
        let result = result.map_err(failure)?;
        let length = result.meta.size;
        let mut state = begin(length, tag(&result))?;
        let (mut stream, mut there) = (result.into_stream(), 0);
        REQUESTS.fetch_add(1, Relaxed);
        while let Some(bytes) =
            std::future::poll_fn(|context| stream.as_mut().poll_next(context)).await
        {
            let bytes = bytes.map_err(failure)?;
            there += bytes.len() as u64;
            BYTES.fetch_add(bytes.len() as u64, Relaxed);
            take(&mut state, bytes)?;
        }
        if there != length {
            let what = format!("has a server that sent {there} of {length} bytes");
            return Err(Failure::Wrong(what));
        }
        Ok(state)
    }
}

/// Returns what tells a version of an object from others: its entity tag, or the time of its
/// change.
fn tag(result: &GetResult) -> String {
    let changed = || result.meta.last_modified.timestamp_millis().to_string();
    result.meta.e_tag.clone().unwrap_or_else(changed)
}

async fn server(base: &Url) -> object_store::Result<Arc<dyn ObjectStore>> {
    let client = ClientOptions::new()
        .with_allow_http(true)
        .with_connect_timeout(CONNECT)
        // A large answer over a slow line takes as long as it takes.
        .with_timeout_disabled()
        .with_read_timeout(NEXT_BYTES);
    let backoff = BackoffConfig { max_backoff: Duration::from_secs(2), ..BackoffConfig::default() };
    let retry = RetryConfig { backoff, max_retries: RETRIES, retry_timeout: RETRYING };
    let is_set = |names: &[&str]| names.iter().any(|name| std::env::var_os(name).is_some());
    Ok(match base.scheme() {
        "s3" => {
            let own = AmazonS3Builder::from_env().with_url(base.as_str()).with_retry(retry);
            let mut own = own.with_client_options(client.clone());
            let credentials = [
                "AWS_ACCESS_KEY_ID",
                "AWS_WEB_IDENTITY_TOKEN_FILE",
                "AWS_CONTAINER_CREDENTIALS_RELATIVE_URI",
                "AWS_CONTAINER_CREDENTIALS_FULL_URI",
                "AWS_SKIP_SIGNATURE",
            ];
            if !is_set(&credentials) {
                own = own.with_skip_signature(true);
            }
            let regions = [
                "AWS_REGION",
                "AWS_DEFAULT_REGION",
                "AWS_ENDPOINT",
                "AWS_ENDPOINT_URL",
                "AWS_ENDPOINT_URL_S3",
            ];
            if let Some(bucket) = base.host_str().filter(|_| !is_set(&regions))
                && let Ok(region) = resolve_bucket_region(bucket, &client).await
            {
                own = own.with_region(region);
            }
            Arc::new(own.build()?)
        }
        "gs" => {
            let own = GoogleCloudStorageBuilder::from_env().with_url(base.as_str());
            let own = own.with_retry(retry).with_client_options(client);
            let credentials = [
                "GOOGLE_SERVICE_ACCOUNT",
                "GOOGLE_SERVICE_ACCOUNT_PATH",
                "GOOGLE_SERVICE_ACCOUNT_KEY",
                "GOOGLE_APPLICATION_CREDENTIALS",
                "GOOGLE_SKIP_SIGNATURE",
            ];
            let own = if is_set(&credentials) { own } else { own.with_skip_signature(true) };
            Arc::new(own.build()?)
        }
        "az" => {
            let own = MicrosoftAzureBuilder::from_env().with_url(base.as_str());
            let own = own.with_retry(retry).with_client_options(client);
            let credentials = [
                "AZURE_STORAGE_ACCOUNT_KEY",
                "AZURE_STORAGE_ACCESS_KEY",
                "AZURE_STORAGE_SAS_KEY",
                "AZURE_STORAGE_SAS_TOKEN",
                "AZURE_STORAGE_TOKEN",
                "AZURE_STORAGE_CLIENT_ID",
                "AZURE_CLIENT_ID",
                "AZURE_SKIP_SIGNATURE",
            ];
            let own = if is_set(&credentials) { own } else { own.with_skip_signature(true) };
            Arc::new(own.build()?)
        }
        _ => {
            let own = HttpBuilder::new().with_url(base.as_str()).with_retry(retry);
            Arc::new(own.with_client_options(client).build()?)
        }
    })
}

/// Returns the innermost cause of an error, on one line.
fn last_cause(error: &(dyn std::error::Error + 'static)) -> String {
    let causes = std::iter::successors(Some(error), |error| error.source());
    let text = causes.last().map(ToString::to_string).unwrap_or_default();
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

fn failure(error: object_store::Error) -> Failure {
    use object_store::Error::{NotFound, NotSupported};
    let text = error.to_string();
    if matches!(error, NotSupported { .. }) || text.contains("non-partial response") {
        return Failure::NoRanges;
    }
    let number = text.split_once("status code: ").map(|(_, rest)| {
        let end = rest.find([':', '\n']).unwrap_or(rest.len());
        rest[..end].trim().to_string()
    });
    let code = number.as_deref().and_then(|number| number.get(..3)).unwrap_or_default();
    let number = number.as_deref().unwrap_or_default();
    Failure::Wrong(match code {
        _ if matches!(error, NotFound { .. }) => return Failure::Missing,
        "401" | "403" => format!(
            "is refused ({number}): it does not exist, or needs credentials, which are read from the environment; see `pointillist guide large_clouds`"
        ),
        "416" => "is empty, or its server gives no parts of it (416)".into(),
        "" if text.contains("without LOCATION") => {
            "is in a bucket of another region; set AWS_REGION to that".into()
        }
        "" => {
            let cause = last_cause(&error);
            let slow = if text.contains("timed out") || cause.contains("timed out") {
                "; the server is too slow or cannot be reached"
            } else {
                ""
            };
            format!("cannot be read: {cause}{slow}")
        }
        _ => format!("has a server that answers {number}"),
    })
}
