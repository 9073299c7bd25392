//! The files NAME.pnti and NAME.shadows, and their contents.
//!
//! `schema` defines planes, node records and the directory; `samples` packs samples into planes;
//! `writer` and `file` write and read an index, `columns` the points of a node; `source` is what a
//! file of nodes does; `shadow_file` reads saved shadows.

mod columns;
mod file;
pub mod morton;
pub mod samples;
pub mod scatter;
pub mod schema;
pub mod shadow_file;
mod source;
pub mod spacing;
mod writer;

pub use file::Index;
pub use schema::{
    Axes, Balance, CHECKSUMS, Contents, Directory, IndexedPart, MAX_STOPS, NodeRecord, PLANES,
    Plane, SINGLE_STATION, TWO_PER_BYTE,
};
pub use source::{NodeSource, Refinement};
pub use writer::Writer;
