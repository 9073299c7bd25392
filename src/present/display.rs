//! WINDOW -> SURFACE.
//!
//! On an X server Vulkan has a connection of its own. Whoever sends much over a connection also takes in what has arrived there: pictures sent over the window's own would take in keys and clicks,
//! of which the window's thread, asleep until something arrives, would hear no sooner than of the next ones.

use crate::error::{Error, Result};
use crate::gpu::{Device, failed};
use ash::vk;
use std::num::NonZeroU32;
use std::ptr::NonNull;
use winit::raw_window_handle::{
    HasDisplayHandle, HasWindowHandle, RawDisplayHandle, RawWindowHandle, XcbDisplayHandle,
    XcbWindowHandle,
};
use winit::window::Window;
use x11rb::xcb_ffi::XCBConnection;

/// The way to the screen that a window is on; it has to outlive its surfaces.
pub struct Display {
    /// And the number of the screen.
    x11: Option<(XCBConnection, i32)>,
}

impl Display {
    pub fn connect(window: &Window) -> Result<Display> {
        let x11 = match handles(window)?.1 {
            RawWindowHandle::Xlib(_) => {
                let (connection, screen) = XCBConnection::connect(None).map_err(|error| {
                    Error::Device(format!("cannot reach the X server ({error})"))
                })?;
                Some((connection, screen as i32))
            }
            _ => None,
        };
        Ok(Display { x11 })
    }

    /// The window has to outlive it, too.
    pub fn surface(&self, device: &Device, window: &Window) -> Result<vk::SurfaceKHR> {
        let (mut display, mut handle) = handles(window)?;
        if let (Some((connection, screen)), RawWindowHandle::Xlib(own)) = (&self.x11, handle) {
            display = RawDisplayHandle::Xcb(XcbDisplayHandle::new(
                NonNull::new(connection.get_raw_xcb_connection()),
                *screen,
            ));
            let number = NonZeroU32::new(own.window as u32)
                .ok_or_else(|| Error::Device("the window has no number".to_string()))?;
            handle = RawWindowHandle::Xcb(XcbWindowHandle::new(number));
        }
        // SAFETY: whoever asks keeps the display and the window longer than the surface, and the device keeps the instance.
        unsafe {
            ash_window::create_surface(&device.entry, &device.instance, display, handle, None)
        }
        .map_err(failed("vkCreateSurfaceKHR"))
    }
}

fn handles(window: &Window) -> Result<(RawDisplayHandle, RawWindowHandle)> {
    let gone = |error| Error::Device(format!("the window has no handle ({error})"));
    Ok((
        window.display_handle().map_err(gone)?.as_raw(),
        window.window_handle().map_err(gone)?.as_raw(),
    ))
}
