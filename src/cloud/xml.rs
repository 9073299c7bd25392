//! Limits of XML, for parsers whose time grows with the square of what a file declares.

/// Most attributes of an element. Each is compared with those before it.
const MOST_ATTRIBUTES: usize = 64;

/// Most declared namespaces. Each element that declares some keeps those around it, too.
const MOST_NAMESPACES: usize = 64;

/// Most elements within each other.
const DEEPEST: usize = 64;

/// Checks the limits, and nothing else: what is no XML is left to the parser. Errors say which
/// limit is exceeded.
pub fn check(xml: &[u8]) -> Result<(), String> {
    let (mut rest, mut depth, mut namespaces) = (xml, 0usize, 0);
    while let Some(at) = memchr::memchr(b'<', rest) {
        rest = &rest[at..];
        let skipped = [("<!--", "-->"), ("<![CDATA[", "]]>"), ("<?", "?>")];
        if let Some((_, end)) = skipped.iter().find(|(start, _)| rest.starts_with(start.as_bytes()))
        {
            let Some(at) = memchr::memmem::find(rest, end.as_bytes()) else { return Ok(()) };
            rest = &rest[at + end.len()..];
            continue;
        }
        let Some(tag) = Tag::of(rest) else { return Ok(()) };
        namespaces += tag.namespaces;
        match rest.get(1) {
            Some(b'/') => depth = depth.saturating_sub(1),
            _ if rest[tag.length - 2] == b'/' => {}
            _ => depth += 1,
        }
        let limits = [
            (tag.attributes, MOST_ATTRIBUTES, "attributes of an element"),
            (namespaces, MOST_NAMESPACES, "namespaces"),
            (depth, DEEPEST, "elements within each other"),
        ];
        if let Some((_, most, what)) = limits.into_iter().find(|(count, most, _)| count > most) {
            return Err(format!("its XML has more than {most} {what}"));
        }
        rest = &rest[tag.length..];
    }
    Ok(())
}

struct Tag {
    /// Bytes, from `<` to `>`.
    length: usize,
    attributes: usize,
    namespaces: usize,
}

impl Tag {
    /// Returns the tag that text begins with; `None` if it does not end.
    fn of(text: &[u8]) -> Option<Tag> {
        let (mut quote, mut attributes, mut namespaces) = (None, 0, 0);
        // Where the last word begins, and whether it has ended.
        let (mut word, mut has_ended) = (0, false);
        for (at, &byte) in text.iter().enumerate() {
            match (quote, byte) {
                (Some(end), _) if byte == end => quote = None,
                (Some(_), _) => {}
                (None, b'"' | b'\'') => quote = Some(byte),
                (None, b'=') => {
                    attributes += 1;
                    namespaces += text[word..at].starts_with(b"xmlns") as usize;
                }
                (None, b'>') => return Some(Tag { length: at + 1, attributes, namespaces }),
                (None, _) if byte.is_ascii_whitespace() => has_ended = true,
                _ if has_ended => (word, has_ended) = (at, false),
                _ => {}
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_are_those_of_what_is_declared() {
        let usual = r#"<?xml version="1.0"?><!-- <a --><e57Root type="Structure" xmlns="u" xmlns:x='v > "w'>
            <a b="1"/><![CDATA[ <c <c <c ]]><a></a></e57Root>"#;
        assert_eq!(check(usual.as_bytes()), Ok(()));
        assert_eq!(check(usual.repeat(20).as_bytes()), Ok(()));
        let refused = |xml: String| check(xml.as_bytes()).unwrap_err();
        let attributes: String = (0..65).map(|i| format!(" a{i} = \"1\"")).collect();
        assert!(refused(format!("<x{attributes}/>")).contains("64 attributes"));
        let names = (0..65).map(|i| format!("<x xmlns:a{i} = \"u\">")).collect::<String>();
        assert!(refused(names.clone()).contains("64 namespaces"), "{names}");
        assert!(refused("<x>".repeat(65)).contains("within each other"));
        assert_eq!(check("<x></x><y/>".repeat(100).as_bytes()), Ok(()));
        for cut in ["<", "<x", "<x a=\"", "<!--", "<x/", "</", "<>", "</>"] {
            assert_eq!(check(cut.as_bytes()), Ok(()), "{cut}");
        }
    }
}
