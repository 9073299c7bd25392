//! Limits, budgets and defaults, each with its reason.

use std::time::Duration;

/// Most points of a node, and the 32-bit words of a page: one plane of one node is one page (256
/// KiB).
pub const POINTS_PER_PAGE: u32 = 65_536;

/// A position plane holds 10 + 10 + 10 bits, so three planes hold nodes up to 2^30 lattice steps
/// wide; wider ones are split.
pub const BITS_PER_PLANE: u32 = 10;
pub const POSITION_PLANES: u32 = 3;

/// Near limit `[m]`: points on or behind the camera plane are not drawn. Dividing by less overflows
/// f32 (guide: numerics, case 3).
pub const NEAR_M: f32 = 1.0 / (1u64 << 63) as f32;

/// Pixels beyond which a picture is drawn in pieces: a frame takes a hundred bytes a pixel and
/// more.
pub const WHOLE_PIXELS: u64 = 3 << 23;

/// The point id where there is no point.
pub const NO_POINT: u32 = 0xFFFF_FFFF;

/// Pages per allocation: 256, 64 MiB. Few allocations, and well below the 256 MiB beyond which
/// lavapipe is unsafe.
pub const PAGES_PER_BLOCK: u32 = 256;

/// Points of a node per workgroup: enough to hide its start, few enough that 16 of them share a
/// page among cores.
pub const POINTS_PER_CHUNK: u32 = 4096;
pub const CHUNKS_PER_PAGE: u32 = POINTS_PER_PAGE / POINTS_PER_CHUNK;

/// Largest quantisation of positions `[px]`, a fifth of the error of f32 arithmetic (guide:
/// numerics, case 1.2). A node is drawn from as few planes as keep it.
pub const QUANTISATION_PX: f64 = 1.0 / 4096.0;

/// Most points of a cut per pixel of the picture: the cost of a frame grows with the picture, not
/// with the cloud.
pub const BUDGET_PER_PIXEL: f64 = 4.0;

/// Least point budget, sixteen full nodes: with less, one node that must be refined as a whole uses
/// up a small picture's budget.
pub const BUDGET_LEAST: u64 = 16 * POINTS_PER_PAGE as u64;

/// Projected error `[px]` at which refinement ends: finer samples would fall into the same pixels.
pub const LOD_PX: f64 = 1.0;

/// Most bytes of pages waiting for the loader. It bounds what one frame uploads, and what a turn of
/// the camera makes useless.
pub const UPLOAD_BYTES: u64 = 32 << 20;

/// The same while pictures move on a software device, which shares its cores with the loader:
/// reading them takes a few milliseconds of a picture's time.
pub const UPLOAD_BYTES_SHARED: u64 = 2 << 20;

/// A slower read of a node is reported, to explain a coarse picture within a second.
pub const PATIENCE: Duration = Duration::from_millis(750);

/// The same of a node on a server, which may be busy for a moment.
pub const PATIENCE_WITH_SERVERS: Duration = Duration::from_secs(5);

/// Default device memory for the pages of an index: the cut of a large picture several times over.
pub const POOL_BYTES: u64 = 1 << 30;

/// Files with more points are indexed before they are drawn: whole clouds take 60 bytes a point.
pub const WHOLE_POINTS: u64 = 20_000_000;

/// The same of files that are painted as strokes, which take 330 bytes a point and long to find: of
/// an index they are found for the nodes of a view.
pub const WHOLE_STROKES: u64 = 4_000_000;

/// Points of a preview while a file is read or indexed: read within a second, and enough to see
/// what it is.
pub const PREVIEW_POINTS: u64 = 1_000_000;

/// A preview of a file that is only read has at most one in this many points, to delay the whole
/// little.
pub const PREVIEW_SHARE: u64 = 8;

/// Points that take about a second to read; larger files are previewed.
pub const SLOW_POINTS: u64 = 8_000_000;

/// A compressed point takes as long to read as this many others.
pub const DECOMPRESSION: u64 = 4;

/// Memory for points being indexed: 100 million points then take one pass through a temporary file.
pub const INDEX_MEMORY: u64 = 2 << 30;

/// Most points of a node of another program's file, which is decoded as a whole: 64 times those of
/// ours.
pub const MOST_NODE_POINTS: u64 = 64 * POINTS_PER_PAGE as u64;

/// Default size of a picture `[px]`.
pub const SIZE: [u32; 2] = [1920, 1080];

/// Default background, sRGB: dark enough for bright scans, light enough for dark ones.
pub const BACKGROUND: [u8; 3] = [0x18, 0x1B, 0x20];

/// Default direction in which sunlight travels: from behind the left shoulder of a viewer with
/// `--view fit`, about 45 degrees high, so that shadows fall into the picture.
pub const SUN: glam::DVec3 = glam::DVec3::new(0.3, 0.8, -0.8);
