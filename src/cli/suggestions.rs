//! Suggestions for a mistyped option: only options that help shows, and commands of that name.

use clap::error::{ContextKind, ContextValue, Error};
use clap::{Arg, Command};

/// Replaces a suggested option that is hidden: by the new name of an old one, or by nothing. Suggests
/// the command that an option is named after. `words` are those of the command line, without the
/// program's name.
pub fn keep_visible(mut error: Error, program: &Command, words: &[String]) -> Error {
    if let Some(ContextValue::String(option)) = error.get(ContextKind::InvalidArg)
        && let Some(meant) = program.find_subcommand(option.trim_start_matches('-'))
    {
        let tip = format!("`{} {}` is a command", program.get_name(), meant.get_name());
        error.remove(ContextKind::SuggestedArg);
        error.insert(ContextKind::Suggested, ContextValue::StyledStrs(vec![tip.into()]));
        return error;
    }
    let command = words.iter().find_map(|word| program.find_subcommand(word)).unwrap_or(program);
    let suggested = match error.get(ContextKind::SuggestedArg) {
        Some(ContextValue::String(option)) => option.trim_start_matches('-').to_owned(),
        _ => return error,
    };
    let names = |argument: &Arg| -> Vec<String> {
        let visible = argument.get_long_and_visible_aliases().unwrap_or_default();
        visible.into_iter().filter(|_| !argument.is_hide_set()).map(str::to_owned).collect()
    };
    let is_meant = |argument: &&Arg| {
        argument.get_long() == Some(&suggested)
            || argument.get_all_aliases().is_some_and(|all| all.contains(&&suggested[..]))
    };
    let visible = command.get_arguments().find(is_meant).map(names).unwrap_or_default();
    if visible.contains(&suggested) {
        return error;
    }
    error.remove(ContextKind::SuggestedArg);
    if let Some(name) = visible.first() {
        error.insert(ContextKind::SuggestedArg, ContextValue::String(format!("--{name}")));
    }
    error
}
