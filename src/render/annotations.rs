//! What a picture shows besides points: title, legend, scale bar, north arrow and axes.

use serde::{Deserialize, Serialize};

/// What to draw over a picture ([`crate::output`]).
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Annotations {
    #[serde(skip_serializing_if = "Option::is_none")]
    pub title: Option<String>,
    pub legend: bool,
    pub scale_bar: bool,
    pub north_arrow: bool,
    pub axes: bool,
}

impl Annotations {
    pub fn is_empty(&self) -> bool {
        *self == Annotations::default()
    }

    /// Returns what either asks for, with the first title that there is.
    pub fn or(self, other: Annotations) -> Annotations {
        Annotations {
            title: self.title.or(other.title),
            legend: self.legend || other.legend,
            scale_bar: self.scale_bar || other.scale_bar,
            north_arrow: self.north_arrow || other.north_arrow,
            axes: self.axes || other.axes,
        }
    }
}
