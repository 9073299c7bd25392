//! Suggestions for a mistyped option: an option that help shows, an effect, or a command.

use crate::passes::EFFECTS;
use crate::similar::similar;
use clap::error::{ContextKind, ContextValue, Error, ErrorKind};
use clap::{Arg, Command};

/// Adds what an unknown option may stand for: the command or the effect of that name, or the
/// visible option with the most similar name, old names included. `words` are those of the command
/// line, without the program's name.
pub fn suggest(mut error: Error, program: &Command, words: &[String]) -> Error {
    let option = match error.get(ContextKind::InvalidArg) {
        Some(ContextValue::String(option)) if error.kind() == ErrorKind::UnknownArgument => {
            option.trim_start_matches('-').to_owned()
        }
        _ => return error,
    };
    error.remove(ContextKind::SuggestedArg);
    error.remove(ContextKind::Suggested);
    // It would name the option that was thought to be similar.
    error.remove(ContextKind::Usage);
    let command = words.iter().find_map(|word| program.find_subcommand(word)).unwrap_or(program);
    let visible: Vec<&Arg> = command.get_arguments().filter(|own| !own.is_hide_set()).collect();
    let known = visible.iter().flat_map(|own| names(own));
    let meant = similar(&option, known).and_then(|name| {
        let own = visible.iter().find(|own| names(own).any(|own| own == name))?;
        let is_shown = own.get_long_and_visible_aliases()?.contains(&name);
        if is_shown { Some(name) } else { own.get_long() }
    });
    let effect = similar(&option, EFFECTS);
    let has_effects = || visible.iter().any(|own| own.get_long() == Some("effect"));
    if let Some(meant) = program.find_subcommand(&option) {
        tip(&mut error, format!("`{} {}` is a command", program.get_name(), meant.get_name()));
    } else if let Some(name) = meant {
        error.insert(ContextKind::SuggestedArg, ContextValue::String(format!("--{name}")));
    } else if let Some(effect) = effect.filter(|_| has_effects()) {
        tip(&mut error, format!("`--effect {effect}=on` switches an effect on"));
    }
    error
}

/// Returns the long name of an option, and those that it had.
fn names(argument: &Arg) -> impl Iterator<Item = &str> {
    argument.get_long().into_iter().chain(argument.get_all_aliases().into_iter().flatten())
}

fn tip(error: &mut Error, text: String) {
    error.insert(ContextKind::Suggested, ContextValue::StyledStrs(vec![text.into()]));
}
