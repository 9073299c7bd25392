//! A file drop from another program: the source's side of the XDND protocol, version 5.

use super::Display;
use std::path::Path;
use std::time::{Duration, Instant};
use x11rb::connection::Connection;
use x11rb::protocol::Event;
use x11rb::protocol::xproto::{
    Atom, ClientMessageEvent, ConnectionExt, CreateWindowAux, EventMask, PropMode,
    SELECTION_NOTIFY_EVENT, SelectionNotifyEvent, WindowClass,
};
use x11rb::rust_connection::RustConnection;
use x11rb::{COPY_DEPTH_FROM_PARENT, CURRENT_TIME};

struct Source {
    display: RustConnection,
    window: u32,
}

impl Source {
    fn atom(&self, name: &str) -> Atom {
        self.display.intern_atom(false, name.as_bytes()).unwrap().reply().unwrap().atom
    }

    fn tell(&self, target: u32, name: &str, rest: [u32; 4]) {
        let [a, b, c, d] = rest;
        let message =
            ClientMessageEvent::new(32, target, self.atom(name), [self.window, a, b, c, d]);
        self.display
            .send_event(false, target, EventMask::NO_EVENT, message)
            .unwrap()
            .check()
            .unwrap();
    }

    /// Answers requests for the file's address until a message of this name comes.
    fn serve(&self, address: &str, until: &str) {
        let (wanted, began) = (self.atom(until), Instant::now());
        loop {
            match self.display.poll_for_event().unwrap() {
                Some(Event::SelectionRequest(request)) => {
                    let (to, property) = (request.requestor, request.property);
                    let bytes = address.as_bytes();
                    self.display
                        .change_property(
                            PropMode::REPLACE,
                            to,
                            property,
                            request.target,
                            8,
                            bytes.len() as u32,
                            bytes,
                        )
                        .unwrap();
                    let answer = SelectionNotifyEvent {
                        response_type: SELECTION_NOTIFY_EVENT,
                        sequence: 0,
                        time: request.time,
                        requestor: to,
                        selection: request.selection,
                        target: request.target,
                        property,
                    };
                    self.display
                        .send_event(false, to, EventMask::NO_EVENT, answer)
                        .unwrap()
                        .check()
                        .unwrap();
                }
                Some(Event::ClientMessage(message)) if message.type_ == wanted => return,
                Some(_) => {}
                None => {
                    assert!(
                        began.elapsed() < Duration::from_secs(60),
                        "no {until} within a minute"
                    );
                    std::thread::sleep(Duration::from_millis(5));
                }
            }
        }
    }
}

/// Drops a file on a window, and waits until its program confirms it.
pub fn drop_file(display: &Display, window: &str, file: &Path) {
    let target: u32 = window.parse().unwrap();
    let (connection, screen) = x11rb::connect(Some(&display.name)).expect("the display");
    let root = connection.setup().roots[screen].root;
    let own = connection.generate_id().unwrap();
    let (depth, class, aux) =
        (COPY_DEPTH_FROM_PARENT, WindowClass::INPUT_OUTPUT, CreateWindowAux::new());
    connection
        .create_window(depth, own, root, 0, 0, 1, 1, 0, class, 0, &aux)
        .unwrap()
        .check()
        .unwrap();
    let source = Source { display: connection, window: own };
    let (selection, uris, copy) =
        (source.atom("XdndSelection"), source.atom("text/uri-list"), source.atom("XdndActionCopy"));
    source.display.set_selection_owner(own, selection, CURRENT_TIME).unwrap().check().unwrap();
    const VERSION: u32 = 5;
    let address = format!("file://{}\r\n", file.display());
    source.tell(target, "XdndEnter", [VERSION << 24, uris, 0, 0]);
    source.tell(target, "XdndPosition", [0, 100 << 16 | 100, CURRENT_TIME, copy]);
    source.serve(&address, "XdndStatus");
    // The address is asked for before the status is sent, and may be read after it: a second
    // position is answered when it has been.
    source.tell(target, "XdndPosition", [0, 101 << 16 | 100, CURRENT_TIME, copy]);
    source.serve(&address, "XdndStatus");
    source.tell(target, "XdndDrop", [0, CURRENT_TIME, 0, 0]);
    source.serve(&address, "XdndFinished");
}
