//! Old spellings of options and benchmarks: they still work, and a note names the new ones.

/// Subcommand that a word belongs to (empty: all), its old spelling and its new one.
const RENAMED: [(&str, &str, &str); 4] = [
    ("", "--pool", "--gpu-memory"),
    ("", "--budget", "--point-budget"),
    ("shadows", "--memory", "--gpu-memory"),
    ("bench", "dobrev", "layers"),
];

/// Returns a note for every old spelling in a command line, without the program's name.
pub fn notes(arguments: &[String]) -> Vec<String> {
    let command = arguments.first().map_or("", String::as_str);
    let words: Vec<&str> = arguments
        .iter()
        .take_while(|argument| *argument != "--")
        .map(|argument| argument.split('=').next().unwrap_or_default())
        .collect();
    RENAMED
        .iter()
        .filter(|(of, old, _)| (of.is_empty() || *of == command) && words.contains(old))
        .map(|(_, old, new)| format!("{old} is an old spelling of {new}"))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::notes;

    #[test]
    fn every_old_spelling_gets_one_note() {
        let said = |line: &str| {
            notes(&line.split_whitespace().map(str::to_string).collect::<Vec<_>>()).join(", ")
        };
        assert_eq!(
            said("render a.las --pool=1MiB --budget 5 --pool 2MiB"),
            "--pool is an old spelling of --gpu-memory, --budget is an old spelling of --point-budget"
        );
        assert_eq!(said("index a.las --memory 1GiB"), "");
        assert_eq!(
            said("shadows a.pnti --memory 1GiB"),
            "--memory is an old spelling of --gpu-memory"
        );
        assert_eq!(said("bench dobrev --json"), "dobrev is an old spelling of layers");
        assert_eq!(said("render --point-budget 5 -- --pool"), "");
    }
}
