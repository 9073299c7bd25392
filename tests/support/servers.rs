//! Servers on loopback: nginx for files, moto for S3, and a proxy before either that is slow or
//! lies.

use crate::skip::skip;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// A running server, which ends with this.
pub struct Server {
    child: Child,
    pub port: u16,
    _folder: tempfile::TempDir,
}

impl Drop for Server {
    fn drop(&mut self) {
        // Nginx ends its workers only if it is asked to end.
        let _ = Command::new("kill").arg(self.child.id().to_string()).status();
        let _ = self.child.wait();
    }
}

fn free_port() -> u16 {
    TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port()
}

impl Server {
    fn wait(self) -> Server {
        let until = Instant::now() + Duration::from_secs(60);
        while TcpStream::connect(("127.0.0.1", self.port)).is_err() {
            assert!(Instant::now() < until, "no server on port {}", self.port);
            std::thread::sleep(Duration::from_millis(20));
        }
        self
    }

    /// Starts nginx on a folder; `None` if it is missing.
    pub fn nginx(files: &Path) -> Option<Server> {
        let (folder, port) = (tempfile::tempdir().unwrap(), free_port());
        let own = folder.path().display();
        let temporary: String = ["client_body", "proxy", "fastcgi", "uwsgi", "scgi"]
            .map(|what| format!("{what}_temp_path {own}/{what};"))
            .concat();
        let user = if cfg!(target_os = "linux") && is_root() { "user root;" } else { "" };
        let config = format!(
            "{user} worker_processes 1; pid {own}/pid; error_log {own}/errors; daemon off;
             events {{}}
             http {{ access_log off; {temporary} server {{ listen 127.0.0.1:{port}; root {}; }} }}",
            files.display()
        );
        let path = folder.path().join("nginx.conf");
        std::fs::write(&path, config).unwrap();
        let start = |program: &str| {
            Command::new(program)
                .arg("-c")
                .arg(&path)
                .stdout(Stdio::null())
                .stderr(Stdio::null())
                .spawn()
        };
        let Ok(child) = start("nginx").or_else(|_| start("/usr/sbin/nginx")) else {
            skip("nginx is missing; Debian has it in nginx-light");
            return None;
        };
        Some(Server { child, port, _folder: folder }.wait())
    }

    /// Starts a server of S3 with a bucket `clouds` of these files; `None` if it is missing.
    pub fn moto(files: &[&Path]) -> Option<Server> {
        let python = || {
            let mut command = Command::new("python3");
            command.env("AWS_ACCESS_KEY_ID", "key").env("AWS_SECRET_ACCESS_KEY", "secret");
            command.env_remove("AWS_PROFILE").env("no_proxy", "127.0.0.1");
            command
        };
        let found =
            python().args(["-c", "import moto.server, boto3"]).stderr(Stdio::null()).status();
        if !found.is_ok_and(|status| status.success()) {
            skip("python3 with moto is missing; pip has it as moto[s3,server]");
            return None;
        }
        let (folder, port) = (tempfile::tempdir().unwrap(), free_port());
        let serve = "from moto.server import main; import sys; main(sys.argv[1:])";
        let child = python()
            .args(["-c", serve, "-H", "127.0.0.1", "-p", &port.to_string()])
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let server = Server { child, port, _folder: folder }.wait();
        let put = format!(
            "import boto3, sys, os
s3 = boto3.client('s3', endpoint_url='http://127.0.0.1:{port}', region_name='us-east-1')
s3.create_bucket(Bucket='clouds')
for file in sys.argv[1:]: s3.upload_file(file, 'clouds', os.path.basename(file))"
        );
        let put = python().arg("-c").arg(put).args(files).output().unwrap();
        assert!(put.status.success(), "{}", String::from_utf8_lossy(&put.stderr));
        Some(server)
    }
}

fn is_root() -> bool {
    Command::new("id").arg("-u").output().is_ok_and(|output| output.stdout.starts_with(b"0"))
}

/// A request as the proxy sees it.
pub struct Request {
    /// Number of requests before it.
    pub number: u64,
    /// First byte that is asked for.
    pub from: Option<u64>,
}

/// What the proxy does with a request.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fault {
    None,
    /// Answers with this status.
    Status(u16),
    /// Closes the connection in the middle of the body.
    Cut,
    /// Sends half of the body as if it were all.
    Short,
    /// Changes the entity tag.
    Tag,
    /// Ignores the range.
    Whole,
    /// Redirects to the server behind.
    Redirect,
    /// Never answers.
    Hang,
}

type Faults = Box<dyn Fn(&Request) -> Fault + Send + Sync>;

/// A proxy, which counts.
pub struct Proxy {
    pub port: u16,
    pub requests: Arc<AtomicU64>,
    pub bytes: Arc<AtomicU64>,
    faults: Arc<Mutex<Faults>>,
}

struct Head {
    lines: Vec<String>,
}

impl Head {
    /// Reads lines up to an empty one; `None` at the end.
    fn read(from: &mut impl BufRead) -> Option<Head> {
        let mut lines = Vec::new();
        loop {
            let mut line = String::new();
            if from.read_line(&mut line).ok()? == 0 {
                return None;
            }
            match line.trim_end() {
                "" => return Some(Head { lines }),
                line => lines.push(line.to_string()),
            }
        }
    }

    fn value(&self, name: &str) -> Option<&str> {
        let values = self.lines.iter().filter_map(|line| line.split_once(':'));
        let mut own = values.filter(|(own, _)| own.eq_ignore_ascii_case(name));
        own.next().map(|(_, value)| value.trim())
    }

    fn set(&mut self, name: &str, value: Option<String>) {
        let begin = format!("{}:", name.to_lowercase());
        self.lines.retain(|line| !line.to_lowercase().starts_with(&begin));
        self.lines.extend(value.map(|value| format!("{name}: {value}")));
    }

    fn bytes(&self) -> Vec<u8> {
        (self.lines.join("\r\n") + "\r\n\r\n").into_bytes()
    }
}

impl Proxy {
    /// Starts before a server, with this latency.
    pub fn start(behind: u16, latency: Duration) -> Proxy {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let proxy = Proxy {
            port: listener.local_addr().unwrap().port(),
            requests: Arc::default(),
            bytes: Arc::default(),
            faults: Arc::new(Mutex::new(Box::new(|_| Fault::None))),
        };
        let (requests, bytes) = (proxy.requests.clone(), proxy.bytes.clone());
        let faults = proxy.faults.clone();
        std::thread::spawn(move || {
            for client in listener.incoming().flatten() {
                let (requests, bytes, faults) = (requests.clone(), bytes.clone(), faults.clone());
                std::thread::spawn(move || {
                    while serve(&client, behind, latency, &requests, &bytes, &faults).is_some() {}
                });
            }
        });
        proxy
    }

    /// Sets faults, and begins to count anew.
    pub fn set(&self, faults: impl Fn(&Request) -> Fault + Send + Sync + 'static) {
        *self.faults.lock().unwrap() = Box::new(faults);
        self.requests.store(0, Relaxed);
        self.bytes.store(0, Relaxed);
    }

    /// Returns requests and bytes of their answers since then.
    pub fn counted(&self) -> [u64; 2] {
        [&self.requests, &self.bytes].map(|count| count.load(Relaxed))
    }
}

/// Serves one request; `None` when the connection ends.
fn serve(
    client: &TcpStream,
    behind: u16,
    latency: Duration,
    requests: &AtomicU64,
    bytes: &AtomicU64,
    faults: &Mutex<Faults>,
) -> Option<()> {
    let mut head = Head::read(&mut BufReader::new(client))?;
    let path = head.lines[0].split(' ').nth(1)?.to_string();
    let from = head.value("range").and_then(|range| range.strip_prefix("bytes="));
    let from = from.and_then(|range| range.split('-').next()?.parse().ok());
    let number = requests.fetch_add(1, Relaxed);
    let fault = faults.lock().unwrap()(&Request { number, from });
    std::thread::sleep(latency);
    let mut client = client;
    match fault {
        Fault::Hang => std::thread::sleep(Duration::from_secs(600)),
        Fault::Status(status) => {
            write!(client, "HTTP/1.1 {status} Fault\r\nContent-Length: 0\r\n\r\n").ok()?;
            return Some(());
        }
        Fault::Redirect => {
            let place = format!("http://127.0.0.1:{behind}{path}");
            write!(client, "HTTP/1.1 302 Found\r\nLocation: {place}\r\nContent-Length: 0\r\n\r\n")
                .ok()?;
            return Some(());
        }
        Fault::Whole => head.set("Range", None),
        _ => {}
    }
    head.set("Connection", Some("close".into()));
    let mut server = TcpStream::connect(("127.0.0.1", behind)).ok()?;
    server.write_all(&head.bytes()).ok()?;
    let mut server = BufReader::new(server);
    let mut answer = Head::read(&mut server)?;
    let mut body = Vec::new();
    server.read_to_end(&mut body).ok()?;
    answer.set("Connection", None);
    match fault {
        Fault::Short => {
            body.truncate(body.len() / 2);
            answer.set("Content-Length", Some(body.len().to_string()));
        }
        Fault::Tag => answer.set("ETag", Some("\"another\"".into())),
        Fault::Cut => {
            client.write_all(&answer.bytes()).ok()?;
            client.write_all(&body[..body.len() / 2]).ok()?;
            return None;
        }
        _ => {}
    }
    bytes.fetch_add(body.len() as u64, Relaxed);
    client.write_all(&answer.bytes()).ok()?;
    client.write_all(&body).ok()
}
