//! What the help of `view`, the window and the guide say of keys.

use crate::program::{pointillist, succeeded, text};
use pointillist::app::keys::rows;
use pointillist::app::navigation::{Mode, NavigationStyle};

/// Returns text with single spaces: lines are wrapped.
fn joined(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

#[test]
fn help_of_view_lists_what_the_window_lists() {
    let output = pointillist().args(["view", "--help"]).output().unwrap();
    succeeded(&output);
    let help = joined(&text(&output.stdout));
    let rows = rows(NavigationStyle::default(), Mode::default());
    assert!(rows.len() > 30);
    for (name, about) in rows {
        assert!(help.contains(&joined(&format!("{name} {about}"))), "{name}: {about}");
    }
}

#[test]
fn the_guide_names_every_key() {
    let guide = include_str!("../../src/guide/window.md");
    let rows = rows(NavigationStyle::default(), Mode::default());
    let drags = |name: &str| ["drag", "click", "wheel"].iter().any(|word| name.contains(word));
    for (name, _) in rows.into_iter().filter(|(name, _)| !drags(name)) {
        assert!(guide.contains(&format!("`{name}`")), "`{name}`");
    }
}
