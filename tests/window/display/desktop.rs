//! An XSETTINGS manager, version 0.5, with one setting: what a desktop tells programs of their
//! monitor.

use super::Display;
use x11rb::connection::Connection;
use x11rb::protocol::xproto::{ConnectionExt, CreateWindowAux, PropMode, WindowClass};
use x11rb::rust_connection::RustConnection;
use x11rb::{COPY_DEPTH_FROM_PARENT, CURRENT_TIME};

pub struct Desktop {
    display: RustConnection,
    window: u32,
    serial: u32,
}

impl Desktop {
    /// Starts the manager with 96 dots per inch; programs look for it when they start.
    pub fn of(display: &Display) -> Desktop {
        let (connection, screen) = x11rb::connect(Some(&display.name)).expect("the display");
        let root = connection.setup().roots[screen].root;
        let window = connection.generate_id().unwrap();
        let (depth, class, aux) =
            (COPY_DEPTH_FROM_PARENT, WindowClass::INPUT_OUTPUT, CreateWindowAux::new());
        connection
            .create_window(depth, window, root, 0, 0, 1, 1, 0, class, 0, &aux)
            .unwrap()
            .check()
            .unwrap();
        let mut desktop = Desktop { display: connection, window, serial: 0 };
        desktop.dots_per_inch(96);
        let manager = desktop.atom(&format!("_XSETTINGS_S{screen}"));
        desktop
            .display
            .set_selection_owner(window, manager, CURRENT_TIME)
            .unwrap()
            .check()
            .unwrap();
        desktop
    }

    fn atom(&self, name: &str) -> u32 {
        self.display.intern_atom(false, name.as_bytes()).unwrap().reply().unwrap().atom
    }

    /// Changes the resolution, as on another monitor.
    pub fn dots_per_inch(&mut self, dots: u32) {
        const INTEGER: u8 = 0;
        let (name, little_endian) = (b"Xft/DPI\0", 0u32);
        let mut settings = Vec::new();
        [little_endian, self.serial, 1].iter().for_each(|word| settings.extend(word.to_le_bytes()));
        settings.extend([INTEGER, 0, 7, 0]);
        settings.extend(name);
        // The unit is 1024th of a dot per inch.
        [self.serial, 1024 * dots].iter().for_each(|word| settings.extend(word.to_le_bytes()));
        let kind = self.atom("_XSETTINGS_SETTINGS");
        let set = self.display.change_property(
            PropMode::REPLACE,
            self.window,
            kind,
            kind,
            8,
            settings.len() as u32,
            &settings,
        );
        set.unwrap().check().unwrap();
        self.serial += 1;
    }
}
