//! The guide: one page a subject, as documentation and for `pointillist guide PAGE`.
//!
//! Pages are Markdown files beside this one. `tools/measure` renders their measured tables.

/// One page of the guide.
pub struct Page {
    /// The name on the command line, and of the file.
    pub name: &'static str,
    /// What the page is about, in a few words.
    pub about: &'static str,
    /// The page itself, Markdown.
    pub text: &'static str,
}

/// Declares a module with the page as its documentation, and its entry in [`PAGES`].
macro_rules! pages {
    ($($name:ident: $about:literal,)*) => {
        $(
            #[doc = include_str!(concat!(stringify!($name), ".md"))]
            pub mod $name {}
        )*

        /// All pages, in reading order.
        pub const PAGES: &[Page] = &[$(Page {
            name: stringify!($name),
            about: $about,
            text: include_str!(concat!(stringify!($name), ".md")),
        }),*];
    };
}

pages! {
    command_line: "commands, options, effects, large pictures, clip boxes, camera paths",
    window: "mouse, keys, panel, measuring, saving",
    filters: "which points are drawn, counted and exported",
    large_clouds: "indexes of clouds larger than memory",
    surfaces: "from points to closed, shaded surfaces",
    layers_and_light: "transparency, shadows, the layer distance",
    luminance: "stations of different brightness",
    strokes: "paintings of clouds",
    formats: "inputs, outputs, coordinates, simulated scans",
    studies: "accuracy against time, benchmarks, measured tables",
    embedding: "the library",
    architecture: "the flow of the data, the modules, the tools",
    adding_an_effect: "one shader, one pass, one line",
    numerics: "what must stay stable, why it breaks, and how it is tested",
    reliability: "what users may rely on when files, disks and devices fail",
    papers: "what was taken from which paper",
    changelog: "what changed",
}

/// Returns the page of this name, also written with hyphens; none if there is no such page.
pub fn page(name: &str) -> Option<&'static Page> {
    PAGES.iter().find(|page| page.name == name.replace('-', "_"))
}
