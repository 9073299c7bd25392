//! One file a pass: from handles to handles. The trunk (project, resolve, composite) and the registry of effects.

pub mod composite;
pub mod project;
pub mod resolve;

use crate::graph::{Graph, Image};
use crate::view::View;

/// What the screen-space passes hand on.
pub struct Layers {
    /// Planar depth, metres; infinite where nothing is.
    pub depth: Image,
    /// Point ids.
    pub index: Image,
    /// Linear colour; alpha 1 where a surface is.
    pub color: Image,
}

/// Off, on, or where the scene calls for it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Switch {
    Off,
    On,
    #[default]
    Auto,
}

/// What effects decide by.
pub struct Scene<'s> {
    pub view: &'s View,
    pub points: u64,
}

/// Why an effect runs, or does not.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Reason {
    pub runs: bool,
    pub why: String,
}

/// The registry: one line an effect, in the order in which they run. It yields the module, the settings, the name on the command line, the switch and the call.
macro_rules! effects {
    ($($name:ident),* $(,)?) => {
        $(pub mod $name;)*

        /// Names of all effects, in the order in which they run.
        pub const EFFECTS: &[&str] = &[$(stringify!($name)),*];

        /// Of every effect: whether the user wants it, and its settings.
        #[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
        pub struct Effects {
            $(pub $name: Asked<$name::Settings>,)*
        }

        impl Effects {
            /// `NAME=off|on|auto[,key=value...]`.
            pub fn set(&mut self, text: &str) -> Result<(), String> {
                let (name, rest) = text.split_once('=').ok_or(format!("{text:?} is not NAME=off|on|auto[,key=value...]"))?;
                match name {
                    $(stringify!($name) => self.$name.set(rest),)*
                    _ => Err(format!("there is no effect {name:?}; there are: {}", EFFECTS.join(", "))),
                }
            }

            /// Whether each effect runs in this scene, and why.
            pub fn decide(&self, scene: &Scene) -> Vec<(&'static str, Reason)> {
                vec![$((stringify!($name), self.$name.decide(stringify!($name), $name::called_for(scene))),)*]
            }

            /// A line of help for every effect and its settings.
            pub fn help() -> String {
                [$(format!("{}: {}\n{}", stringify!($name), $name::SUMMARY, Asked::<$name::Settings>::help())),*].join("\n")
            }
        }

        /// Every effect that runs, in order.
        pub fn apply(g: &mut Graph, view: &View, effects: &Effects, decided: &[(&'static str, Reason)], mut layers: Layers) -> Layers {
            let runs = |name| decided.iter().any(|(effect, reason)| *effect == name && reason.runs);
            $(if runs(stringify!($name)) {
                layers = $name::record(g, view, &effects.$name.settings, layers);
            })*
            layers
        }
    };
}

effects! {
    edl, // depth, color -> color
}

/// A setting of an effect as the command line knows it: name, unit and meaning, and its value.
pub struct Setting<'s> {
    pub name: &'static str,
    pub about: &'static str,
    pub value: &'s mut f64,
    pub range: std::ops::RangeInclusive<f64>,
}

/// What an effect's settings can say of themselves.
pub trait Settings: Default {
    fn list(&mut self) -> Vec<Setting<'_>>;
}

/// A switch and settings.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Asked<S> {
    pub switch: Switch,
    #[serde(flatten)]
    pub settings: S,
}

impl<S: Settings> Asked<S> {
    fn set(&mut self, text: &str) -> Result<(), String> {
        for item in text.split(',') {
            match item {
                "off" => self.switch = Switch::Off,
                "on" => self.switch = Switch::On,
                "auto" => self.switch = Switch::Auto,
                _ => {
                    let (key, value) = item.split_once('=').ok_or(format!("{item:?} is neither off, on, auto nor key=value"))?;
                    let mut settings = self.settings.list();
                    let names = settings.iter().map(|setting| setting.name).collect::<Vec<_>>().join(", ");
                    let setting = settings.iter_mut().find(|setting| setting.name == key);
                    let setting = setting.ok_or(format!("there is no setting {key:?}; there are: {names}"))?;
                    let number: f64 = value.parse().map_err(|_| format!("{key}={value:?} is not a number"))?;
                    if !setting.range.contains(&number) {
                        return Err(format!("{key}={value} is not between {} and {}", setting.range.start(), setting.range.end()));
                    }
                    *setting.value = number;
                }
            }
        }
        Ok(())
    }

    fn decide(&self, name: &str, called_for: Reason) -> Reason {
        match self.switch {
            Switch::Auto => called_for,
            Switch::On => Reason { runs: true, why: format!("asked for with --effect {name}=on") },
            Switch::Off => Reason { runs: false, why: format!("switched off with --effect {name}=off") },
        }
    }

    fn help() -> String {
        let mut settings = S::default();
        settings
            .list()
            .iter()
            .map(|s| format!("    {}={}  {} ({} to {})", s.name, s.value, s.about, s.range.start(), s.range.end()))
            .collect::<Vec<_>>()
            .join("\n")
    }
}
