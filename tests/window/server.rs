//! A cloud on a server in the window, while the server is well and while it is not.

use crate::display::place::Place;
use crate::png_file::read_png;
use crate::program::{pointillist, succeeded};
use crate::servers::{Fault, Proxy, Server};
use std::path::Path;
use std::time::Duration;

#[test]
fn a_cloud_on_a_server_is_shown_as_render_draws_it_and_nodes_that_fail_come_later() {
    let place = Place::new();
    let (cloud, name) = (place.street(1_000_000), "street.copc.laz");
    let mut export = pointillist();
    export.arg("export").arg(&cloud).arg("-o").arg(place.at(name));
    succeeded(&export.output().unwrap());
    let Some(server) = Server::nginx(&place.at("")) else { return };
    let proxy = Proxy::start(server.port, Duration::from_millis(20));
    let address = format!("http://127.0.0.1:{}/{name}", proxy.port);
    let address = Path::new(&address);
    let line = "--lod 1";
    let picture = place.picture(&[address], "server.png", "--lod 1 --no-cache");
    let mut viewer = place.view(&[address], line);
    viewer.shows(&picture);
    viewer.close();

    // Nodes that the server does not have are said, the window goes on, and they come in the end.
    let length = std::fs::metadata(place.at(name)).unwrap().len();
    proxy.set(move |request| match request.from {
        Some(from) if from > length / 3 && from + 200_000 < length => Fault::Status(404),
        _ => Fault::None,
    });
    let mut viewer = place.view(&[address], line);
    viewer.until("404", |viewer| viewer.said().iter().any(|line| line.contains("404")));
    viewer.key("Escape");
    let scene = place.saved(&mut viewer, "F8", "pointillist-1.json");
    assert!(scene.exists());
    proxy.set(|_| Fault::None);
    // They are asked for again when the picture is drawn anew. A saved one is without messages.
    let (wanted, mut numbers) = (read_png(&picture), 1..);
    viewer.until("the whole picture", |viewer| {
        ["7", "0"].into_iter().for_each(|key| viewer.key(key));
        // The view takes a moment to turn.
        std::thread::sleep(Duration::from_secs(3));
        let name = format!("pointillist-{}.png", numbers.next().unwrap());
        read_png(&place.saved(viewer, "F9", &name)).pixels == wanted.pixels
    });
    // A message may have come, which the first key closes.
    viewer.leave();
    viewer.close();
}
