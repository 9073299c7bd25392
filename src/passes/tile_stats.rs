//! Statistics of a frame by tile: the lists that passes made on the device, counted afterwards.

use super::shadows::Method;
use super::visibility;
use super::{Effects, GBuffer, LIST_HEADER, TILE_PX, TileLists, fill, significant, tiles};
use crate::graph::{Buffer, CompletedSubmission, Graph};

/// Lists that are read back with the frame; None for passes that do not run.
pub struct Asked {
    lists: TileLists,
    unpeeled: Option<Buffer>,
    left: Option<Buffer>,
}

/// Counts of 8 x 8 pixel tiles.
#[derive(Clone, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Counts {
    /// Tiles of the whole picture.
    pub tiles: u64,
    /// Tiles where points could be hidden, by the cell width of the level that looked `[px]`; 1 is
    /// the picture.
    pub looked_at: Vec<(u32, u64)>,
    /// The same as a map: one string per row of tiles, with the number of the coarsest level that
    /// looked, 0 for the picture, or a dot.
    pub looked_at_map: Vec<String>,
    /// Tiles with pixels to fill: `#`, or a dot.
    pub holes_map: Vec<String>,
    /// Neighbours of pixels in these tiles: the reads if finer levels decide nothing.
    pub taps: u64,
    /// Tiles with pixels to fill.
    pub holes: u64,
    /// Steps of filling until nothing changed.
    pub filling_steps: u32,
    /// Steps of filling by masks: of background and of hidden pixels; None if another method fills.
    pub mask_steps: Option<[u32; 2]>,
    /// Tiles that are not planar: deeper levels of shape depiction shade them and their neighbours.
    pub rough: u64,
    /// Tiles with filled pixels or a neighbour of one, which are smoothed; None if smoothing does
    /// not run.
    pub smoothed: Option<u64>,
    /// Tiles with jumps in depth, which are blended; None if anti-aliasing does not run.
    pub silhouettes: Option<u64>,
    /// Texels of the light's pictures where index peeling ended early.
    pub unpeeled: u64,
    /// True if some pixels have more transparent layers than were drawn.
    pub left_over: bool,
}

impl Asked {
    pub fn of(g: &mut Graph, gbuffer: &GBuffer) -> Asked {
        let mut read = |list: &Option<Buffer>| list.as_ref().map(|list| g.download_buffer(list));
        let TileLists { looked_at, holes, median_steps, mask_steps, rough, smoothed, silhouettes } =
            &gbuffer.tile_lists;
        let lists = TileLists {
            looked_at: read(looked_at),
            holes: read(holes),
            median_steps: read(median_steps),
            rough: read(rough),
            smoothed: read(smoothed),
            silhouettes: read(silhouettes),
            mask_steps: mask_steps
                .as_ref()
                .map(|steps| steps.each_ref().map(|list| g.download_buffer(list))),
        };
        Asked {
            lists,
            unpeeled: unpeeled(g, gbuffer),
            left: gbuffer.accumulation.as_ref().map(|front| g.download_buffer(&front.left)),
        }
    }

    pub fn counts(&self, frame: &CompletedSubmission, size: [u32; 2], effects: &Effects) -> Counts {
        let words =
            |list: &Option<Buffer>| list.as_ref().map_or(&[][..], |list| frame.read::<u32>(list));
        let listed = |list: &Option<Buffer>| {
            words(list).get(LIST_HEADER as usize - 1).copied().unwrap_or_default() as u64
        };
        let [across, down] = tiles(size);
        let by_level = visibility::listed(size, words(&self.lists.looked_at));
        let holes = visibility::in_list(words(&self.lists.holes));
        let taken = |steps: &[u32]| fill::steps_taken(steps, across * down);
        let neighbours = (effects.visibility.settings.kernel as u64).pow(2) - 1;
        let taps = |(_, tiles): &(u32, &[u32])| {
            tiles.len() as u64 * (TILE_PX * TILE_PX) as u64 * neighbours
        };
        let map = |marked: &mut dyn Iterator<Item = (char, u32)>| {
            let mut marks = vec![vec!['.'; across as usize]; down as usize];
            marked.for_each(|(mark, tile)| {
                marks[(tile / across) as usize][(tile % across) as usize] = mark
            });
            marks.into_iter().map(String::from_iter).collect::<Vec<_>>()
        };
        let digit =
            |cells: &u32| char::from_digit(cells.ilog2(), 10).expect("there are fewer levels");
        Counts {
            tiles: across as u64 * down as u64,
            taps: by_level.iter().map(taps).sum(),
            looked_at: by_level
                .iter()
                .filter(|(_, tiles)| !tiles.is_empty())
                .map(|(cells, tiles)| (*cells, tiles.len() as u64))
                .collect(),
            looked_at_map: map(&mut by_level
                .iter()
                .flat_map(|(cells, tiles)| tiles.iter().map(|tile| (digit(cells), *tile)))),
            holes_map: map(&mut holes.iter().map(|tile| ('#', *tile))),
            holes: holes.len() as u64,
            filling_steps: if !holes.is_empty() {
                taken(words(&self.lists.median_steps))
            } else {
                0
            },
            mask_steps: self
                .lists
                .mask_steps
                .as_ref()
                .map(|both| both.each_ref().map(|steps| taken(frame.read::<u32>(steps)))),
            unpeeled: words(&self.unpeeled).first().copied().unwrap_or_default() as u64,
            left_over: words(&self.left).first().is_some_and(|left| *left > 0),
            rough: listed(&self.lists.rough),
            smoothed: self.lists.smoothed.is_some().then(|| listed(&self.lists.smoothed)),
            silhouettes: self.lists.silhouettes.is_some().then(|| listed(&self.lists.silhouettes)),
        }
    }
}

/// Reads back in how many texels index peeling ended early, if this frame cast shadows.
fn unpeeled(g: &mut Graph, gbuffer: &GBuffer) -> Option<Buffer> {
    let unpeeled = gbuffer.light_visibility.as_ref()?.unpeeled.as_ref()?;
    Some(g.download_buffer(unpeeled))
}

/// Returns a note if index peeling ended early in some texels.
fn cut_off(texels: u64) -> Option<String> {
    (texels > 0).then(|| {
        format!(
            "index peeling of shadows ended early in {texels} texels: more peels, or method=depth"
        )
    })
}

/// Warnings that are only known after a frame has run.
pub struct Warned {
    unpeeled: Option<Buffer>,
}

impl Warned {
    pub fn ask(g: &mut Graph, effects: &Effects, gbuffer: &GBuffer) -> Warned {
        let peels = effects.shadows.settings.method == Method::Index;
        Warned { unpeeled: if peels { unpeeled(g, gbuffer) } else { None } }
    }

    pub fn note(&self, frame: &CompletedSubmission) -> Option<String> {
        cut_off(self.unpeeled.as_ref().map_or(0, |list| frame.read::<u32>(list)[0] as u64))
    }
}

impl Counts {
    /// Returns the number of tiles where points could be hidden.
    pub fn looked(&self) -> u64 {
        self.looked_at_map.iter().flat_map(|row| row.bytes()).filter(|mark| *mark != b'.').count()
            as u64
    }
}

impl std::fmt::Display for Counts {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let levels: Vec<_> = self
            .looked_at
            .iter()
            .map(|(cells, tiles)| format!("{tiles} in cells of {cells}"))
            .collect();
        let levels =
            if levels.is_empty() { String::new() } else { format!(" ({})", levels.join(", ")) };
        let filled = match self.mask_steps {
            Some([background, occluded]) => {
                format!(
                    "filled by masks, in {background} steps of background and {occluded} of hidden pixels"
                )
            }
            None if self.filling_steps > 0 => {
                format!("{} with pixels to fill, in {} steps", self.holes, self.filling_steps)
            }
            None => format!("{} with pixels to fill", self.holes),
        };
        write!(
            f,
            "{} of {TILE_PX} x {TILE_PX} pixels; {} checked for hidden points{levels}; {filled}; {} shaded by more than one level of shape",
            self.tiles,
            self.looked(),
            self.rough
        )?;
        let percent = |tiles: u64| significant(100.0 * tiles as f64 / self.tiles as f64);
        if let Some(smoothed) = self.smoothed {
            write!(f, "; {smoothed} smoothed ({} %)", percent(smoothed))?;
        }
        if let Some(silhouettes) = self.silhouettes {
            write!(f, "; {silhouettes} with silhouettes ({} %)", percent(silhouettes))?;
        }
        cut_off(self.unpeeled).map_or(Ok(()), |cut_off| write!(f, "; {cut_off}"))?;
        if self.left_over {
            write!(
                f,
                "; some pixels have more layers than were drawn: --effect transparency=layers=N"
            )?;
        }
        Ok(())
    }
}
