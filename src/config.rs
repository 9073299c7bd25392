//! Every limit, budget and default, one sentence each, saying what follows from it.

use std::time::Duration;

/// A node has at most this many points, and a page holds as many 32-bit words: one plane of one node is one page (256 KiB).
pub const POINTS_PER_PAGE: u32 = 65_536;

/// A position plane holds 10 + 10 + 10 bits, so three planes hold nodes up to 2^30 lattice steps wide; wider ones are split.
pub const BITS_PER_PLANE: u32 = 10;
pub const POSITION_PLANES: u32 = 3;

/// Points on or behind the camera plane are not drawn; this near, and no nearer, because dividing by less overflows f32 (HARD_CASES 1.3).
pub const NEAR_M: f32 = 1.0 / (1u64 << 63) as f32;

/// The point id, the index target's value, where there is no point.
pub const NO_POINT: u32 = 0xFFFF_FFFF;

/// Pages are allocated 256 at a time, 64 MiB: few allocations, and well below the 256 MiB beyond which lavapipe is unsafe.
pub const PAGES_PER_BLOCK: u32 = 256;

/// A workgroup walks this many points of a node: long enough to hide its start, short enough that 16 of them share a page among cores.
pub const POINTS_PER_CHUNK: u32 = 4096;
pub const CHUNKS_PER_PAGE: u32 = POINTS_PER_PAGE / POINTS_PER_CHUNK;

/// A node is drawn from as few position planes as keep its quantisation below this many pixels, a fifth of what f32 arithmetic costs (HARD_CASES 1.2).
pub const QUANTISATION_PX: f64 = 1.0 / 4096.0;

/// A cut has at most this many points a pixel of the picture: what a frame costs grows with the picture, not with the cloud.
pub const BUDGET_PER_PIXEL: f64 = 4.0;

/// But never fewer than sixteen nodes full: with less, one node that must be refined as a whole uses up a small picture's budget.
pub const BUDGET_LEAST: u64 = 16 * POINTS_PER_PAGE as u64;

/// A node whose samples stand for cells of at most this many pixels is not refined: finer ones would fall into the same pixels.
pub const LOD_PX: f64 = 1.0;

/// At most so many bytes of pages wait for the loader at any time: it bounds what one frame takes in, and what a turn of the camera makes useless.
pub const UPLOAD_BYTES: u64 = 32 << 20;

/// The same while pictures move on a software device, with which the loader shares its cores: reading them takes a few milliseconds of a picture's time.
pub const UPLOAD_BYTES_SHARED: u64 = 2 << 20;

/// A node that takes longer to read is said, so that whoever looks at a coarse picture knows why within a second.
pub const PATIENCE: Duration = Duration::from_millis(750);

/// Device memory for the pages of an index when nothing is asked for: the cut of a large picture several times over.
pub const POOL_BYTES: u64 = 1 << 30;

/// Files with more points than this are indexed before they are drawn: whole clouds take 60 bytes a point.
pub const WHOLE_POINTS: u64 = 20_000_000;

/// Points of a file that are shown while it is being read or indexed: read within a second, and enough to see what it is.
pub const PREVIEW_POINTS: u64 = 1_000_000;

/// And of one that is only read at most one point in so many, so that whoever waits for the whole waits little longer.
pub const PREVIEW_SHARE: u64 = 8;

/// Files take about a second to be read from so many points on, and are shown in part before.
pub const SLOW_POINTS: u64 = 8_000_000;

/// A compressed point takes as long to be read as so many others.
pub const DECOMPRESSION: u64 = 4;

/// Memory for points on their way into an index: a tenth of a billion points then take one pass through a temporary file.
pub const INDEX_MEMORY: u64 = 2 << 30;

/// Size of a picture when nothing is asked for.
pub const SIZE: [u32; 2] = [1920, 1080];

/// sRGB colour behind the points when nothing is asked for: dark enough for bright scans, light enough for dark ones.
pub const BACKGROUND: [u8; 3] = [0x18, 0x1B, 0x20];

/// The way in which the light of a sun travels that nobody has placed: from behind the left shoulder of who looks at a cloud as `--view fit` does, about 45 degrees high, so that shadows fall into the picture.
pub const SUN: glam::DVec3 = glam::DVec3::new(0.3, 0.8, -0.8);
