//! The name that a mistyped one stands for.

/// Returns the most similar of these names, unless more than a third of the letters differ.
pub fn similar<S: AsRef<str>>(word: &str, names: impl IntoIterator<Item = S>) -> Option<S> {
    let word = word.to_lowercase();
    let changes = |name: &S| strsim::osa_distance(&word, name.as_ref());
    let near = names.into_iter().min_by_key(changes)?;
    (3 * changes(&near) <= word.chars().count()).then_some(near)
}

/// Returns a question for an error about a mistyped name, in parentheses, or nothing.
pub fn did_you_mean<S: AsRef<str>>(word: &str, names: impl IntoIterator<Item = S>) -> String {
    similar(word, names)
        .map(|name| format!(" (did you mean {:?}?)", name.as_ref()))
        .unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn letters_that_are_wrong_missing_swapped_or_too_many_are_forgiven() {
        let names = ["ground", "building", "water", "rail"];
        for (word, name) in [
            ("grund", Some("ground")),
            ("Gruond", Some("ground")),
            ("bilding", Some("building")),
            ("waterr", Some("water")),
            ("tree", None),
            ("", None),
        ] {
            assert_eq!(similar(word, names), name, "{word}");
        }
        assert_eq!(did_you_mean("wather", names), " (did you mean \"water\"?)");
        assert_eq!(did_you_mean("x", [""; 0]), "");
    }
}
