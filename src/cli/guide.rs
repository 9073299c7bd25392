//! `pointillist guide`: prints a page of the guide, or lists the pages.

use super::streams;
use crate::error::{Error, Result};
use crate::guide;

const EXAMPLES: &str = "\
Examples:
  pointillist guide                  the pages
  pointillist guide surfaces         one page
  pointillist guide surfaces | less";

#[derive(clap::Args, Clone, Debug)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// Page to print [default: a list of the pages]
    #[arg(value_name = "PAGE")]
    pub page: Option<String>,
}

/// Prints the page, or the list of pages. Errors if there is no such page.
pub fn run(arguments: &Arguments) -> Result<()> {
    let text = match &arguments.page {
        None => list(),
        Some(name) => {
            let page = guide::page(name).ok_or_else(|| {
                let names: Vec<&str> = guide::PAGES.iter().map(|page| page.name).collect();
                let names = names.join(", ");
                Error::Request(format!("the guide has no page {name:?}; its pages are {names}"))
            })?;
            let is_shown = |line: &&str| !line.starts_with("<!--");
            page.text.lines().filter(is_shown).flat_map(|line| [line, "\n"]).collect()
        }
    };
    streams::print(&text)
}

fn list() -> String {
    let line = |page: &guide::Page| format!("  {:<18} {}\n", page.name, page.about);
    let pages: String = guide::PAGES.iter().map(line).collect();
    format!("Pages, for pointillist guide PAGE:\n{pages}")
}
