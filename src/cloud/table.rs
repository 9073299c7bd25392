//! What a table of text is: how its lines fall into fields, how its numbers are written, and what each column is taken for.
//!
//! In: the beginning of a text ([`sniff`]), and what was asked for ([`TextOptions`]). Out: a [`Table`], decided once, that every line is then read by
//! ([`mod@line`]), and that says itself in one sentence, which a note repeats. Nothing about a line is guessed anew.

mod heading;
pub mod line;
mod names;
pub mod sniff;
mod values;

use super::from_floats::{ColorUnit, Role};
use super::input::Input;
use super::{Extra, text};
use std::fmt;
use std::str::FromStr;

/// What lies between fields.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Delimiter {
    Comma,
    Semicolon,
    /// One tab, so that fields may be empty.
    Tab,
    /// Any number of spaces and tabs.
    Space,
}

impl Delimiter {
    /// `None` for runs of blanks.
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

/// More columns than this are not named on a command line.
const MOST_COLUMNS: usize = 64;

/// The roles of all columns, in their order, as `--columns` gives them.
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

/// What is said of text files instead of being found out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TextOptions {
    pub delimiter: Option<Delimiter>,
    pub columns: Option<Columns>,
    /// The name of the column that intensities are read from.
    pub scalar: Option<&'static str>,
}

impl TextOptions {
    /// Everything is found out.
    pub const NONE: TextOptions = TextOptions { delimiter: None, columns: None, scalar: None };

    /// The note on a file that is no table, where something is said of tables.
    pub(super) fn idle(&self, input: &Input) -> Option<String> {
        (*self != TextOptions::NONE).then(|| {
            format!(
                "{}: --columns, --delimiter and --scalar have no effect: it is not a text table",
                input.name()
            )
        })
    }
}

/// How a line becomes fields, and a field a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reading {
    pub delimiter: Delimiter,
    /// A comma begins the fraction, not a point.
    pub decimal_comma: bool,
    /// Commas are between fields and within every number: two pieces make one number.
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
    /// As the file has it.
    pub name: Option<String>,
    pub role: Role,
    /// Holds words, not numbers.
    pub is_text: bool,
}

impl Column {
    /// Whether it holds numbers that are no part of a point.
    pub fn is_extra(&self) -> bool {
        self.role == Role::Other && !self.is_text
    }
}

/// What says what columns are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// The names in this line.
    Names(u64),
    /// Names, but none of x, y and z: these are the first columns of numbers that have no other meaning.
    Partly(u64),
    /// Their order and values.
    Values,
    Asked,
}

#[derive(Clone, Debug)]
pub struct Table {
    pub reading: Reading,
    pub columns: Vec<Column>,
    /// The last column is a text of several words, between blanks.
    pub words_at_end: bool,
    /// Return numbers without numbers of returns: each counts as the last.
    pub lacks_returns: bool,
    pub source: Source,
    /// Points that a line of one number before the first promises.
    pub count: Option<u64>,
    /// Where the first row begins, bytes from the beginning of the text, and how many lines lie before.
    pub body_at: usize,
    pub lines_before: u64,
    /// A remark that seems to name other columns.
    pub unfit: Option<String>,
    /// Lines with numbers before the first row that are no row: which they are, and what is in them.
    pub odd: Vec<(u64, String)>,
    /// Lines of words before the first row that are no names and no comments.
    pub passed: u64,
}

impl Table {
    pub fn roles(&self) -> Vec<Role> {
        self.columns.iter().map(|column| column.role).collect()
    }

    /// Colours of columns whose names end in f, for fractions, are fractions.
    pub fn color_unit(&self) -> ColorUnit {
        let are_fractions =
            self.columns.iter().filter(|column| matches!(column.role, Role::Color(_))).all(
                |column| {
                    let name = column.name.as_deref().map(names::key).unwrap_or_default();
                    names::FRACTIONS.contains(&name.as_str())
                },
            );
        if are_fractions && self.roles().contains(&Role::Color(0)) {
            ColorUnit::Unit
        } else {
            ColorUnit::Guess
        }
    }

    /// What columns are taken for, in their order.
    pub fn words(&self) -> String {
        self.columns.iter().map(|column| word(column.role)).collect::<Vec<_>>().join(" ")
    }

    /// A name for messages.
    pub fn title(&self, column: usize) -> String {
        match &self.columns[column].name {
            Some(name) => format!("\"{name}\""),
            None => format!("column {} ({})", column + 1, word(self.columns[column].role)),
        }
    }

    /// A column as an attribute of its own, before any value.
    pub fn extra(&self, column: usize) -> Extra {
        let name =
            self.columns[column].name.clone().unwrap_or_else(|| format!("column {}", column + 1));
        Extra { name, ..Extra::default() }
    }

    /// What nothing in the file says, or what is not kept of it: roles that columns have by their order and values alone, and columns of words. That the first three numbers are coordinates is no guess.
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

    /// Names of columns that are no part of a point: of numbers, and of words.
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

/// How it is read, what was taken for what, and what is not.
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

/// As `--columns` and messages say it.
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
        Role::Other => "-",
    }
}
