//! What accuracy costs in time on a device: settings that trade one for the other, the front of
//! those that no other beats, and the one to draw with for a time or an error.
//!
//! ```text
//!     knobs -> Tuning -> `study::tune` measures -> Front -> its file -> Choice for a picture
//! ```
//!
//! The reference of an error is the picture of the same view by the finest tuning (`error`): kind
//! *self*, not truth. The time of a picture is predicted as milliseconds a point drawn and
//! a pixel, both of the tuning itself (`front`). A cut tells its points before anything is
//! drawn, and one drawn picture corrects both numbers for its own cloud and view.

pub mod error;
pub mod front;
pub mod governor;
pub mod knobs;
pub mod store;

pub use error::Errors;
pub use front::{Choice, Correction, Front, Limit, Load, Tuned, split};
pub use governor::Governor;
pub use knobs::{KNOBS, Tuning};
