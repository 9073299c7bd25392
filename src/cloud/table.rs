//! The format of a text table: delimiters, number format, and the role of each column.
//!
//! The format is decided once from the beginning of a text ([`sniff`]) and the user's options
//! ([`TextOptions`]). The resulting [`Table`] reads every line ([`mod@line`]) and describes itself
//! in a note.

mod heading;
pub mod line;
mod names;
pub mod sniff;
mod values;

use super::floats::{ColorUnit, Role};
use super::input::Input;
use super::{Extra, text};
use std::fmt;
use std::str::FromStr;

/// The separator of fields.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Delimiter {
    Comma,
    Semicolon,
    /// A single tab, so that fields may be empty.
    Tab,
    /// Runs of spaces and tabs.
    Space,
}

impl Delimiter {
    /// Returns the byte; `None` for runs of blanks.
    fn byte(self) -> Option<u8> {
        match self {
            Delimiter::Comma => Some(b','),
            Delimiter::Semicolon => Some(b';'),
            Delimiter::Tab => Some(b'\t'),
            Delimiter::Space => None,
        }
    }

    fn plural(self) -> &'static str {
        match self {
            Delimiter::Comma => "commas",
            Delimiter::Semicolon => "semicolons",
            Delimiter::Tab => "tabs",
            Delimiter::Space => "spaces",
        }
    }
}

impl fmt::Display for Delimiter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Delimiter::Comma => "comma",
            Delimiter::Semicolon => "semicolon",
            Delimiter::Tab => "tab",
            Delimiter::Space => "space",
        })
    }
}

impl FromStr for Delimiter {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "," | "comma" => Ok(Delimiter::Comma),
            ";" | "semicolon" => Ok(Delimiter::Semicolon),
            "\t" | "\\t" | "tab" => Ok(Delimiter::Tab),
            " " | "space" => Ok(Delimiter::Space),
            _ => Err(format!("{text:?} is not a delimiter; give one of , ; tab space")),
        }
    }
}

/// Most columns named on a command line.
const MOST_COLUMNS: usize = 64;

/// The roles of all columns in order, as in `--columns`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Columns {
    roles: [Role; MOST_COLUMNS],
    count: usize,
}

impl Columns {
    pub fn roles(&self) -> &[Role] {
        &self.roles[..self.count]
    }
}

impl fmt::Display for Columns {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = |role: &Role| if *role == Role::Other { "-" } else { word(*role) };
        f.write_str(&self.roles().iter().map(name).collect::<Vec<_>>().join(","))
    }
}

impl FromStr for Columns {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let mut columns = Columns { roles: [Role::Other; MOST_COLUMNS], count: 0 };
        for name in text.split(',').map(str::trim) {
            let role = if name == "-" { Some(Role::Other) } else { names::role(name) };
            let role = role.ok_or_else(|| {
                format!(
                    "{name:?} is not a column; known are {}, and - to skip one",
                    names::listed()
                )
            })?;
            if role != Role::Other && columns.roles().contains(&role) {
                return Err(format!("{} is given twice", word(role)));
            }
            if columns.count == MOST_COLUMNS {
                return Err(format!("there are more than {MOST_COLUMNS} columns"));
            }
            columns.roles[columns.count] = role;
            columns.count += 1;
        }
        match (0..3).map(Role::Position).find(|role| !columns.roles().contains(role)) {
            Some(role) => Err(format!("{} is missing", word(role))),
            None => Ok(columns),
        }
    }
}

/// The user's options for text files.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TextOptions {
    pub delimiter: Option<Delimiter>,
    pub columns: Option<Columns>,
    /// Name of the column to read as intensity.
    pub scalar: Option<&'static str>,
}

impl TextOptions {
    /// Options that detect everything.
    pub const NONE: TextOptions = TextOptions { delimiter: None, columns: None, scalar: None };

    /// Returns a note if options for tables are given for another format.
    pub(super) fn idle(&self, input: &Input) -> Option<String> {
        (*self != TextOptions::NONE).then(|| {
            format!(
                "{}: --columns, --delimiter and --scalar have no effect: it is not a text table",
                input.name()
            )
        })
    }
}

/// The way to split lines and parse numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reading {
    pub delimiter: Delimiter,
    /// True if the decimal mark is a comma.
    pub decimal_comma: bool,
    /// True if commas separate fields and are decimal marks: two pieces make one number.
    pub paired: bool,
}

impl fmt::Display for Reading {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mark = if self.decimal_comma { "decimal commas" } else { "decimal points" };
        write!(f, "fields between {}, {mark}", self.delimiter.plural())
    }
}

#[derive(Clone, Debug, PartialEq)]
pub struct Column {
    /// Name in the file.
    pub name: Option<String>,
    pub role: Role,
    /// True if it holds words.
    pub is_text: bool,
}

impl Column {
    /// Tests whether it holds numbers that are not part of a point.
    pub fn is_extra(&self) -> bool {
        self.role == Role::Other && !self.is_text
    }
}

/// The origin of column roles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// Names in this line.
    Names(u64),
    /// Names without x, y and z, which are the first numeric columns without another role.
    Partly(u64),
    /// Order and values.
    Values,
    Asked,
}

#[derive(Clone, Debug)]
pub struct Table {
    pub reading: Reading,
    pub columns: Vec<Column>,
    /// True if the last column is text of several words, separated by blanks.
    pub words_at_end: bool,
    /// True if there are return numbers without numbers of returns: each counts as the last.
    pub lacks_returns: bool,
    pub source: Source,
    /// Number of points in a line of its own before the first row.
    pub count: Option<u64>,
    /// Beginning of the first row `[bytes]`, and the number of lines before it.
    pub body_at: usize,
    pub lines_before: u64,
    /// A comment that seems to name other columns.
    pub unfit: Option<String>,
    /// Numeric lines before the first row that are not rows: line number and contents.
    pub odd: Vec<(u64, String)>,
    /// Number of other lines before the first row that are neither names nor comments.
    pub passed: u64,
}

impl Table {
    pub fn roles(&self) -> Vec<Role> {
        self.columns.iter().map(|column| column.role).collect()
    }

    /// Returns the unit of colours: fractions if column names end in f.
    pub fn color_unit(&self) -> ColorUnit {
        let are_fractions =
            self.columns.iter().filter(|column| matches!(column.role, Role::Color(_))).all(
                |column| {
                    let name = column.name.as_deref().map(names::normalized).unwrap_or_default();
                    names::FRACTIONS.contains(&name.as_str())
                },
            );
        if are_fractions && self.roles().contains(&Role::Color(0)) {
            ColorUnit::Unit
        } else {
            ColorUnit::Guess
        }
    }

    /// Returns the roles of columns in order.
    pub fn words(&self) -> String {
        self.columns.iter().map(|column| word(column.role)).collect::<Vec<_>>().join(" ")
    }

    /// Returns a column's name for messages.
    pub fn title(&self, column: usize) -> String {
        match &self.columns[column].name {
            Some(name) => format!("\"{name}\""),
            None => format!("column {} ({})", column + 1, word(self.columns[column].role)),
        }
    }

    /// Returns a column as an extra attribute without values.
    pub fn extra(&self, column: usize) -> Extra {
        let name =
            self.columns[column].name.clone().unwrap_or_else(|| format!("column {}", column + 1));
        Extra { name, ..Extra::default() }
    }

    /// Describes guesses and losses: roles by order and values alone, and text columns. That the
    /// first three numbers are coordinates is not a guess.
    pub fn guess_or_loss(&self) -> Option<String> {
        let has_more = self
            .columns
            .iter()
            .any(|column| !matches!(column.role, Role::Position(_) | Role::Other));
        let [_, texts] = self.left_aside();
        match self.source {
            Source::Asked => None,
            Source::Values if has_more => {
                Some(format!("has no column names; by their values they could be {}", self.words()))
            }
            Source::Partly(line) => Some(format!("names no x, y and z in line {line}")),
            _ => (!texts.is_empty())
                .then(|| format!("has text columns, which are not kept: {}", texts.join(", "))),
        }
    }

    /// Returns the names of columns outside of points: numeric ones, and text.
    fn left_aside(&self) -> [Vec<String>; 2] {
        let name = |(place, column): (usize, &Column)| {
            let name = column
                .name
                .as_ref()
                .map_or(format!("column {}", place + 1), |name| format!("\"{name}\""));
            let is_long = self.words_at_end && place + 1 == self.columns.len();
            if is_long { format!("{name} (of several words)") } else { name }
        };
        let aside = |is_text: bool| {
            let own = self
                .columns
                .iter()
                .enumerate()
                .filter(|(_, column)| column.role == Role::Other && column.is_text == is_text);
            own.map(name).collect()
        };
        [aside(false), aside(true)]
    }
}

/// Describes the format: delimiters, roles, ignored columns.
impl fmt::Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}; ", self.reading)?;
        let taken = || {
            let used = self.columns.iter().filter(|column| column.role != Role::Other);
            used.map(|column| {
                format!("{} \"{}\"", word(column.role), column.name.as_deref().unwrap_or_default())
            })
            .collect::<Vec<_>>()
        };
        match self.source {
            Source::Names(line) => {
                write!(f, "columns by their names in line {line}: {}", taken().join(", "))?
            }
            Source::Partly(line) => write!(
                f,
                "no x, y and z among the names in line {line}, so that the first columns are taken for them: {}",
                taken().join(", ")
            )?,
            Source::Values => write!(
                f,
                "no names; by their order and values columns are taken as {}",
                self.words()
            )?,
            Source::Asked => write!(f, "columns as asked for: {}", self.words())?,
        }
        let [extras, texts] = self.left_aside();
        if !extras.is_empty() && self.source != Source::Asked {
            write!(
                f,
                "; further attributes, one of which --scalar reads as intensity: {}",
                extras.join(", ")
            )?;
        }
        if !texts.is_empty() && self.source != Source::Asked {
            write!(f, "; text that is not kept: {}", texts.join(", "))?;
        }
        if let Some(unfit) = &self.unfit {
            write!(f, "; {unfit}")?;
        }
        if self.lacks_returns {
            f.write_str("; no numbers of returns: each return counts as the last")?;
        }
        if self.passed > 0 {
            write!(f, "; {} before them passed over", text::lines_in_words(self.passed))?;
        }
        Ok(())
    }
}

/// Returns the word of a role as in `--columns`.
pub fn word(role: Role) -> &'static str {
    match role {
        Role::Position(axis) => ["x", "y", "z"][axis],
        Role::Color(channel) => ["red", "green", "blue"][channel],
        Role::Normal(axis) => ["nx", "ny", "nz"][axis],
        Role::Intensity => "intensity",
        Role::Class => "class",
        Role::Return => "return",
        Role::Returns => "returns",
        Role::Source => "source",
        Role::Time => "time",
        Role::Scalar(..) => "scalar",
        Role::Other => "-",
    }
}
