//! What the user asked for + what the scene calls for -> the look of this frame, with reasons.

use crate::light::Light;
use crate::passes::project::Precision;
use crate::passes::{Decided, Effects, Scene, Switch, resolve};
use crate::resident::Resident;
use crate::view::View;

/// How points become a picture: which effects may run when nothing is said of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Style {
    /// A surface: what is hidden is hidden, holes are filled, shape is shaded
    #[default]
    Surface,
    /// Every point one pixel
    Points,
}

impl Effects {
    pub fn of(style: Style) -> Effects {
        let mut effects = Effects::default();
        if style == Style::Points {
            effects.visibility.switch = Switch::Off;
            effects.fill.switch = Switch::Off;
            effects.shape.switch = Switch::Off;
        }
        effects
    }
}

/// What the user asked for, whatever the scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Wishes {
    pub effects: Effects,
    pub light: Light,
    /// sRGB.
    pub background: [u8; 3],
    pub precision: Precision,
}

impl Wishes {
    /// Every point one pixel.
    pub fn points() -> Wishes {
        Wishes { effects: Effects::of(Style::Points), ..Wishes::default() }
    }
}

impl Default for Wishes {
    fn default() -> Self {
        Wishes { effects: Effects::default(), light: Light::default(), background: crate::config::BACKGROUND, precision: Precision::Auto }
    }
}

/// How this frame is drawn.
#[derive(Clone, Debug, PartialEq)]
pub struct Look {
    pub effects: Effects,
    pub decided: Decided,
    pub light: Light,
    /// Linear.
    pub background: [f32; 3],
    pub precision: Precision,
}

pub fn decide(wishes: &Wishes, view: &View, resident: &Resident) -> Look {
    Look {
        effects: wishes.effects.clone(),
        decided: wishes.effects.decide(&Scene::of(view, resident, wishes.light)),
        light: wishes.light,
        background: wishes.background.map(|channel| resolve::srgb_to_linear(channel as f64 / 255.0) as f32),
        precision: wishes.precision,
    }
}
