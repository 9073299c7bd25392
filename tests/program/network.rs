//! Clouds on servers: the picture of the file byte for byte, few requests, and what slow, cut and
//! lying servers do to it. The servers are nginx and moto on loopback, with a proxy that counts.

use crate::files::scan;
use crate::octree_files::{KINDS, records, write};
use crate::program::{failed, pointillist, succeeded, text};
use crate::servers::{Fault, Proxy, Server};
use pointillist::synth::SceneKind;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

/// A folder with files, of which a server gives `files`.
struct Place {
    folder: tempfile::TempDir,
}

const POINTS: &str = "--style points --effect edl=off --effect exposure=off --effect luminance=off --size 480x270 --explain=json";

impl Place {
    fn empty() -> Place {
        let place = Place { folder: tempfile::tempdir().unwrap() };
        std::fs::create_dir(place.at("files")).unwrap();
        place
    }

    /// A scan of this many points, as COPC.
    fn new(points: u64) -> Place {
        let place = Place::empty();
        scan(&place.at("street.las"), SceneKind::Street, points);
        place.make("export", "street.copc.laz");
        place
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn file(&self, name: &str) -> String {
        self.at("files").join(name).display().to_string()
    }

    /// Makes a file of the scan by a subcommand.
    fn make(&self, subcommand: &str, name: &str) {
        let mut command = pointillist();
        command.arg(subcommand).arg(self.at("street.las")).arg("-o").arg(self.file(name));
        succeeded(&command.output().unwrap());
    }

    /// Returns a command with a cache of this place's own. Words that begin with @ are its files.
    fn command(&self, line: &str) -> Command {
        let mut command = pointillist();
        for name in ["http_proxy", "https_proxy", "HTTP_PROXY", "HTTPS_PROXY", "all_proxy"] {
            command.env_remove(name);
        }
        let folder = format!("{}/", self.folder.path().display());
        command.args(line.split_whitespace().map(|word| word.replace('@', &folder)));
        if !line.contains("--no-cache") {
            command.args(["--cache-dir".into(), self.at("cache")]);
        }
        command
    }

    fn run(&self, line: &str) -> Output {
        self.command(line).output().unwrap()
    }

    fn picture(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.at(name)).unwrap()
    }

    fn forget(&self) {
        let _ = std::fs::remove_dir_all(self.at("cache"));
    }
}

fn explained(output: &Output) -> Value {
    serde_json::from_slice(&output.stdout).unwrap()
}

fn number(value: &Value) -> u64 {
    value.as_u64().unwrap_or_else(|| panic!("no number: {value}"))
}

/// Draws a cloud from its file and from a proxy: the same picture, of the requests that are told.
#[track_caller]
fn check_same(place: &Place, proxy: &Proxy, name: &str, line: &str, per_node: f64) {
    let line = format!("{POINTS} {line}");
    succeeded(&place.run(&format!("render {} -o @file.png {line}", place.file(name))));
    place.forget();
    proxy.set(|_| Fault::None);
    let address = format!("http://127.0.0.1:{}/{name}", proxy.port);
    let drawn = place.run(&format!("render {address} -o @server.png {line}"));
    let said = succeeded(&drawn);
    assert!(!said.contains("cannot"), "{said}");
    assert_eq!(place.picture("file.png"), place.picture("server.png"), "{name}");
    let index = explained(&drawn)["index"].clone();
    let [requests, bytes] = proxy.counted();
    let nodes = number(&index["nodes"]);
    println!(
        "{name}: {nodes} nodes, {requests} requests, {bytes} bytes of {}",
        index["index_bytes"]
    );
    // What is told is told before later requests; nothing follows the last node.
    let [told, told_bytes] = ["requests", "bytes"].map(|of| number(&index["network"][of]));
    assert_eq!(requests, told);
    // Texts of answers that a file is not there are not counted.
    assert!((told_bytes..told_bytes + 1000).contains(&bytes), "{bytes} {told_bytes}");
    assert!(requests as f64 <= per_node * nodes as f64, "{requests} requests for {nodes} nodes");
    // The second time all comes from the cache, as far as the server may have another version.
    proxy.set(|_| Fault::None);
    succeeded(&place.run(&format!("render {address} -o @again.png {line}")));
    let [again, _] = proxy.counted();
    assert_eq!(place.picture("file.png"), place.picture("again.png"));
    // Of a folder, the description of each kind is asked for.
    assert!(
        again <= if name.contains('.') { 1 } else { 2 },
        "{name}: {again} requests for what is in the cache"
    );
}

#[test]
fn a_cloud_on_a_server_is_drawn_as_its_file_with_few_requests() {
    let place = Place::new(1_500_000);
    place.make("index", "street.pnti");
    let Some(server) = Server::nginx(&place.at("files")) else { return };
    let proxy = Proxy::start(server.port, Duration::ZERO);
    for name in ["street.copc.laz", "street.pnti"] {
        check_same(&place, &proxy, name, "--lod 0.5", 1.3);
        check_same(&place, &proxy, name, "--lod 2", 1.5);
    }
    let point = |i: i32| {
        let [x, y] = [i.wrapping_mul(7919), i.wrapping_mul(104_729)].map(|v| v.rem_euclid(100_003));
        ([x, y, 20_000 + x / 16], [(x >> 9) as u8, (y >> 9) as u8, 90])
    };
    let (at, rgb): (Vec<_>, Vec<_>) = (0..60_000).map(point).unzip();
    let records = records(&at, &rgb);
    for kind in KINDS {
        let name = format!("{kind:?}");
        write(kind, &place.at("files").join(&name), &records);
        // Few nodes: the lists and descriptions are requests, too.
        check_same(&place, &proxy, &name, "--lod 1", 4.0);
        check_same(&place, &proxy, &format!("{name}/"), "--lod 1", 4.0);
    }
}

#[test]
fn s3_with_a_latency_of_50_ms_is_little_slower_than_a_disk() {
    let place = Place::new(4_000_000);
    let file = place.file("street.copc.laz");
    let Some(server) = Server::moto(&[Path::new(&file)]) else { return };
    let proxy = Proxy::start(server.port, Duration::from_millis(50));
    let timed = |input: &str, line: &str| {
        let mut command = place.command(&format!("render {input} --no-cache {POINTS} {line}"));
        command.env("AWS_ACCESS_KEY_ID", "key").env("AWS_SECRET_ACCESS_KEY", "secret");
        command.env("AWS_REGION", "us-east-1").env("AWS_ALLOW_HTTP", "true");
        command.env("AWS_ENDPOINT", format!("http://127.0.0.1:{}", proxy.port));
        let began = Instant::now();
        let output = command.output().unwrap();
        let took = began.elapsed().as_secs_f64();
        succeeded(&output);
        (took, explained(&output))
    };
    let address = "s3://clouds/street.copc.laz";
    let best = |input: &str, line: &str| {
        let runs = [0, 1, 2].map(|_| timed(input, line));
        runs.into_iter().reduce(|a, b| if a.0 <= b.0 { a } else { b }).unwrap()
    };
    let (first, _) = best(address, "--lod 16 -o @first.png");
    let (settled, told) = best(address, "--lod 1 --point-budget 2000000 -o @server.png");
    let (local, _) = best(&file, "--lod 1 --point-budget 2000000 -o @file.png");
    let index = &told["index"];
    let [nodes, requests] = [&index["nodes"], &index["network"]["requests"]].map(number);
    println!(
        "first picture {first:.2} s, settled {settled:.2} s, of the file {local:.2} s; {nodes} nodes, {requests} requests, {} bytes",
        index["network"]["bytes"]
    );
    assert_eq!(place.picture("file.png"), place.picture("server.png"));
    assert!(first < 2.0, "a first picture after {first} s");
    assert!(requests as f64 <= 1.3 * nodes as f64, "{requests} requests for {nodes} nodes");
    // Buckets that ask for credentials are refused with words.
    proxy.set(|_| Fault::Status(403));
    let said = failed(
        &place
            .command("info s3://clouds/none.laz --no-cache")
            .env("AWS_ENDPOINT", format!("http://127.0.0.1:{}", proxy.port))
            .env("AWS_ALLOW_HTTP", "true")
            .output()
            .unwrap(),
        1,
    );
    assert!(said.contains("403") && said.contains("credentials"), "{said}");
}

#[test]
fn faults_of_a_server_are_said_and_drawn_by_parents() {
    let place = Place::new(1_000_000);
    let name = "street.copc.laz";
    let Some(server) = Server::nginx(&place.at("files")) else { return };
    let proxy = Proxy::start(server.port, Duration::ZERO);
    let line = format!(
        "render http://127.0.0.1:{}/{name} {POINTS} --lod 0.5 -o @server.png --no-cache",
        proxy.port
    );
    succeeded(&place.run(&format!("render {} {POINTS} --lod 0.5 -o @file.png", place.file(name))));
    let file = place.picture("file.png");

    // A server that is busy or cut off for a moment, or elsewhere, costs time.
    for fault in [Fault::Status(503), Fault::Status(429), Fault::Cut] {
        proxy.set(move |request| if request.number % 4 == 1 { fault } else { Fault::None });
        let said = succeeded(&place.run(&line));
        assert_eq!(file, place.picture("server.png"), "{fault:?}: {said}");
    }
    proxy.set(|_| Fault::Redirect);
    succeeded(&place.run(&line));
    assert_eq!(file, place.picture("server.png"));

    // One without ranges is read whole.
    proxy.set(|_| Fault::Whole);
    let said = succeeded(&place.run(&line));
    assert!(said.contains("gives no parts of files"), "{said}");
    assert_eq!(file, place.picture("server.png"));

    // Later faults leave what was read: the first nodes.
    let length = std::fs::metadata(place.file(name)).unwrap().len();
    for (fault, words) in [
        (Fault::Status(500), "500"),
        (Fault::Status(404), "404"),
        (Fault::Status(416), "416"),
        (Fault::Tag, "changed on its server"),
        (Fault::Short, ""),
    ] {
        let is_hit = move |from: u64| from > length / 2 && from + 200_000 < length;
        proxy.set(move |request| match request.from {
            Some(from) if is_hit(from) => fault,
            _ => Fault::None,
        });
        let began = Instant::now();
        let said = succeeded(&place.run(&line));
        println!("{fault:?}: {:.1} s, {}", began.elapsed().as_secs_f64(), said.trim());
        assert!(said.contains(words) && said.contains(name), "{fault:?}: {said}");
        assert_ne!(file, place.picture("server.png"), "{fault:?}");
    }
    let strict = place.run(&format!("{line} --strict"));
    assert_eq!(strict.status.code(), Some(1));
    let said = text(&strict.stderr);
    assert!(said.contains(name), "{said}");

    // Nothing can be drawn of a server that fails at once.
    proxy.set(|_| Fault::Status(500));
    let said = failed(&place.run(&line), 1);
    assert!(said.contains("500"), "{said}");
    proxy.set(|_| Fault::Status(404));
    assert!(failed(&place.run(&line), 1).contains("not there (404)"));
}

#[test]
fn other_files_on_a_server_are_fetched_whole_and_kept() {
    let place = Place::new(100_000);
    for name in ["street.ply", "street.laz", "street.csv"] {
        place.make("export", name);
    }
    let Some(server) = Server::nginx(&place.at("files")) else { return };
    let proxy = Proxy::start(server.port, Duration::ZERO);
    let told = |input: &str| {
        let output = place.run(&format!("info {input} --json"));
        succeeded(&output);
        let part = explained(&output)["parts"][0].clone();
        ["points", "bounds", "attributes", "step"].map(|what| part[what].clone())
    };
    for name in ["street.ply", "street.laz", "street.csv"] {
        let address = format!("http://127.0.0.1:{}/{name}?signature=a/b", proxy.port);
        assert_eq!(told(&address), told(&place.file(name)), "{name}");
        assert_eq!(told(&format!("file://{}", place.file(name))), told(&place.file(name)));
        proxy.set(|_| Fault::None);
        told(&address);
        assert_eq!(proxy.counted()[0], 1, "{name} is in the cache");
        let said = failed(&place.run(&format!("info {address} --cache-size 100kB")), 1);
        assert!(said.contains("--cache-size"), "{said}");
    }
    // The cache keeps within its size: two files do not fit.
    let kept = || -> u64 {
        let entries = std::fs::read_dir(place.at("cache/network")).unwrap();
        entries.map(|entry| entry.unwrap().metadata().unwrap().len()).sum()
    };
    let largest = std::fs::metadata(place.file("street.csv")).unwrap().len();
    let line = format!("--cache-size {}", largest * 11 / 10);
    for name in ["street.csv", "street.ply", "street.csv"] {
        let address = format!("http://127.0.0.1:{}/{name}", proxy.port);
        succeeded(&place.run(&format!("info {address} {line}")));
        assert!(kept() < largest * 13 / 10, "{} bytes of {largest}", kept());
    }
    // An octree's tree is told without its points.
    proxy.set(|_| Fault::None);
    let address = format!("http://127.0.0.1:{}/street.copc.laz", proxy.port);
    let output = place.run(&format!("info {address} --json"));
    succeeded(&output);
    assert_eq!(explained(&output)["points"], 100_000);
    // Exact numbers and exports read them.
    let output = place.run(&format!("info {address} --json --count"));
    succeeded(&output);
    assert_eq!(explained(&output)["points"], 100_000);
    succeeded(&place.run(&format!("export {address} -o @out.laz")));
    assert_eq!(told(&place.at("out.laz").display().to_string())[0], 100_000);
}

#[test]
fn a_server_that_never_answers_can_be_left() {
    let place = Place::new(100_000);
    let Some(server) = Server::nginx(&place.at("files")) else { return };
    let proxy = Proxy::start(server.port, Duration::ZERO);
    let length = std::fs::metadata(place.file("street.copc.laz")).unwrap().len();
    // At once, and in the middle of the nodes.
    for from in [0, length / 3] {
        proxy.set(move |request| match request.from {
            Some(own) if own >= from => Fault::Hang,
            _ => Fault::None,
        });
        let address = format!("http://127.0.0.1:{}/street.copc.laz", proxy.port);
        let mut command = place.command(&format!("render {address} {POINTS} -o @a.png"));
        let child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        std::thread::sleep(Duration::from_millis(1500));
        let began = Instant::now();
        Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
        let output = child.wait_with_output().unwrap();
        let took = began.elapsed();
        println!("from byte {from}: left after {:.2} s", took.as_secs_f64());
        assert_eq!(output.status.code(), Some(130), "{}", text(&output.stderr));
        assert!(took < Duration::from_secs(2), "{took:?}");
        assert!(!place.at("a.png").exists());
    }
}
