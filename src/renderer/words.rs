//! Settings as words: those of the command line and of scene files.

use super::{Error, Limit, Renderer, Result};
use crate::cloud::color_scale::{ColorScale, Ramp, number, range};
use crate::cloud::length::Length;
use crate::names::{Named, parse_list};
use crate::passes::Effects;
use crate::render::settings::{Background, Style};
use crate::select::clip::Clips;
use crate::select::opacity::Opacities;
use crate::view::light::Light;

/// Returns a scale with one of its values replaced.
fn scale_with(
    scale: ColorScale,
    name: &str,
    value: &str,
) -> std::result::Result<ColorScale, String> {
    let is_set = value != "auto";
    match name {
        "ramp" => {
            let ramp = is_set.then(|| Ramp::named(value)).transpose()?;
            ColorScale { ramp, ..scale }
        }
        "range" => ColorScale { range: is_set.then(|| range(value)).transpose()?, ..scale },
        "brightness" => ColorScale { brightness: number(value)?, ..scale },
        "contrast" => ColorScale { contrast: number(value)?, ..scale },
        _ => ColorScale { gamma: number(value)?, ..scale },
    }
    .checked()
}

impl Renderer {
    /// Sets what a scene file or the command line has under `name`:
    ///
    /// - `style`: `auto`, `surface`, `points`, `splats` or `strokes`, which sets all effects
    /// - `effect`: `NAME=off|on|auto[,key=value...]`
    /// - `light`: `headlight`, `direction:X,Y,Z` or `position:X,Y,Z`, in the host's world
    /// - `background`: `RRGGBB` in hexadecimal digits
    /// - `layer`: distance below which surfaces count as one, in the unit of the cloud's
    ///   coordinates, or with a unit, such as `0.1m`; 0 is automatic
    /// - `opacity` and `clip`: rules and boxes, separated by `;`, which replace those before; boxes
    ///   are in each cloud's own coordinates
    /// - `only` and `not`: conditions separated by `;`, such as `class=ground;z=0..50`, of clouds
    ///   that are opened or added from then on: of their points those are left that match all of
    ///   `only` and none of `not`
    /// - `lod`: distance of samples on the screen to which nodes of an index are refined `[px]`;
    ///   `budget`: most points of an index drawn in a view; `auto` for either is automatic. Files
    ///   that are opened while one is set are indexed
    /// - `ramp`: colours of numbers, `grey`, `terrain`, `viridis`, `cividis` or `turbo`; `range`:
    ///   the numbers at its ends, `LO,HI`; `auto` for either is automatic
    /// - `brightness`, `contrast` and `gamma` of what is shown
    /// - `time`: most time of a frame's pictures such as `50ms`, and `error`: the largest such as
    ///   `0.5px` ([`Renderer::set_limit`]); `none` for neither
    ///
    /// Errors name what is wrong, and leave everything as it was.
    pub fn set(&mut self, name: &str, value: &str) -> Result<()> {
        let refused = |why: String| Error::Request(format!("{name}={value}: {why}"));
        let items = || value.split(';').map(str::trim).filter(|item| !item.is_empty());
        match name {
            "style" => {
                let style = Style::named(value).map_err(refused)?;
                self.settings.effects = Effects::of(style);
            }
            "effect" => {
                let mut effects = self.settings.effects.clone();
                effects.set(value).map_err(refused)?;
                self.settings.effects = effects;
            }
            "light" => self.settings.light = value.parse::<Light>().map_err(refused)?,
            "background" => {
                self.settings.background = value.parse::<Background>().map_err(refused)?.0;
            }
            "layer" => {
                let layer = value.parse::<Length>().map_err(refused)?;
                if layer.number() < 0.0 {
                    return Err(refused("not a distance of 0 or more".into()));
                }
                self.settings.layer = layer;
            }
            "opacity" => self.opacities = Opacities(parse_list(items()).map_err(refused)?),
            "clip" => self.clips = Clips(parse_list(items()).map_err(refused)?),
            "only" => self.filter.only = parse_list(items()).map_err(refused)?,
            "not" => self.filter.not = parse_list(items()).map_err(refused)?,
            "lod" | "budget" if value == "auto" => match name {
                "lod" => self.lod.lod_px = None,
                _ => self.lod.budget = None,
            },
            "lod" => {
                let pixels = value.parse().ok().filter(|px: &f64| px.is_finite() && *px >= 0.0);
                let wrong = || refused("not a number of pixels, 0 or more".into());
                self.lod.lod_px = Some(pixels.ok_or_else(wrong)?);
            }
            "budget" => {
                let points = value.parse().map_err(|_| refused("not a number of points".into()))?;
                self.lod.budget = Some(points);
            }
            "ramp" | "range" | "brightness" | "contrast" | "gamma" => {
                self.scale = scale_with(self.scale, name, value).map_err(refused)?;
            }
            "time" | "error" if value == "none" => self.set_limit(None)?,
            "time" => self.set_limit(Some(Limit::time(value).map_err(refused)?))?,
            "error" => self.set_limit(Some(value.parse().map_err(refused)?))?,
            _ => {
                return Err(refused(
                    "there is no such setting; there are: style, effect, light, background, layer, opacity, clip, only, not, lod, budget, ramp, range, brightness, contrast, gamma, time, error".into(),
                ));
            }
        }
        self.revision += 1;
        Ok(())
    }
}
