//! Surfaces of windows.
//!
//! On an X server Vulkan gets a connection of its own. Sending over a connection also reads what
//! has arrived on it. Pictures sent over the window's own would read its keys and clicks, and the
//! window's thread, which sleeps until something arrives, would get them only with the next event.

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

/// A connection to the screen of a window; it has to outlive its surfaces.
pub struct Display {
    /// The connection, and the number of the screen; None on Wayland.
    x11: Option<(XCBConnection, i32)>,
}

impl Display {
    /// Connects to the window's X server, if it is on one.
    pub fn connect(window: &Window) -> Result<Display> {
        let x11 = match handles(window)?.1 {
            RawWindowHandle::Xlib(_) => {
                let (connection, screen) = XCBConnection::connect(None).map_err(|error| {
                    Error::Device(format!(
                        "cannot connect to the X server ({error}); check DISPLAY"
                    ))
                })?;
                Some((connection, screen as i32))
            }
            _ => None,
        };
        Ok(Display { x11 })
    }

    /// Creates a surface, which the display and the window have to outlive.
    pub fn surface(&self, device: &Device, window: &Window) -> Result<vk::SurfaceKHR> {
        let (mut display, mut handle) = handles(window)?;
        if let (Some((connection, screen)), RawWindowHandle::Xlib(own)) = (&self.x11, handle) {
            display = RawDisplayHandle::Xcb(XcbDisplayHandle::new(
                NonNull::new(connection.get_raw_xcb_connection()),
                *screen,
            ));
            let number = NonZeroU32::new(own.window as u32)
                .ok_or_else(|| Error::Device("the window has no X11 id".to_string()))?;
            handle = RawWindowHandle::Xcb(XcbWindowHandle::new(number));
        }
        // SAFETY: the caller keeps display and window longer than the surface, and the device keeps
        // the instance.
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
