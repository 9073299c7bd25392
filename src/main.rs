//! The program: parses, dispatches, and exits with 0 on success, 1 on failure, 2 on wrong usage,
//! 130 on Ctrl-C.

use clap::{Arg, ArgAction, Command as Clap, CommandFactory, FromArgMatches, Parser};
use pointillist::cli::{
    bench, export, guide, index, info, profile, raster, renamed, render, shadows, streams, study,
    suggestions, synth, terminal::Terminal, tune, view,
};
use pointillist::error::Error;
use pointillist::thread_pool;
use std::ffi::OsString;
use std::io::{ErrorKind, Write};
use std::process::ExitCode;

const EXAMPLES: &str = "\
Examples:
  pointillist view scan.laz
  pointillist render scan.laz -o out.png
  pointillist view https://example.org/site.copc.laz       in place, on a server
  pointillist info scan.laz
  pointillist export scan.laz -o ground.laz --only ground
  pointillist raster scan.laz -o surface.tif --resolution 0.5
  pointillist index huge.laz -o huge.pnti
  pointillist synth street -o street.laz --points 2000000
  pointillist COMMAND --help                               options and more examples";

/// Draws raw, unstructured point clouds, with no normals, no radii and no waiting.
#[derive(Parser)]
#[command(version, about, max_term_width = 120, after_help = EXAMPLES)]
struct Program {
    #[command(subcommand)]
    command: Command,
}

#[derive(clap::Subcommand)]
enum Command {
    /// Open a window to fly through point clouds
    View(Box<view::Arguments>),
    /// Draw a picture of one or several point clouds
    Render(Box<render::Arguments>),
    /// Build an index of clouds larger than memory, which view, render, info and bench read like a
    /// file
    Index(index::Arguments),
    /// Save the shadows of all points of an index
    Shadows(shadows::Arguments),
    /// Write the points that filters and clip boxes leave to a file: LAS, LAZ, PLY, CSV
    Export(Box<export::Arguments>),
    /// Write a map of heights, intensities, counts or colours: GeoTIFF, a cell by its points
    Raster(Box<raster::Arguments>),
    /// Print what is in a file: counts, bounds and ranges of the points themselves
    Info(info::Arguments),
    /// Draw the points of a vertical slab between two places, or list them in a table
    Profile(Box<profile::Arguments>),
    /// Simulate scans of analytic scenes, with ground truth
    Synth(synth::Arguments),
    /// Measure what accuracy costs in time on this device, for --time and --error
    Tune(Box<tune::Arguments>),
    /// Measure accuracy against time
    Study(study::Arguments),
    /// Measure passes against other ways of doing the same
    Bench(bench::Arguments),
    /// Print pages of the guide
    Guide(guide::Arguments),
}

/// Prints to standard error; a closed standard error does not change the exit code.
fn say(what: &str) {
    streams::say(format_args!("pointillist: {what}"));
}

/// Prints what the library logs and cannot return: errors of objects that are being dropped.
struct Logger;

impl log::Log for Logger {
    fn enabled(&self, metadata: &log::Metadata) -> bool {
        metadata.level() == log::Level::Error && metadata.target().starts_with("pointillist")
    }

    fn log(&self, record: &log::Record) {
        if self.enabled(record.metadata()) {
            say(&record.args().to_string());
        }
    }

    fn flush(&self) {}
}

/// Returns the topic of `--help TOPIC`, and the words without it.
fn help_topic(words: Vec<OsString>) -> (Option<String>, Vec<OsString>) {
    let is_help = |word: &OsString| ["-h", "--help"].iter().any(|help| word == help);
    let topic = words.iter().position(is_help).and_then(|at| words.get(at + 1));
    let topic = topic.and_then(|word| word.to_str());
    let topic = topic.filter(|word| ["all", "effects"].contains(word)).map(str::to_owned);
    match topic.as_deref() {
        Some("effects") => {
            let effects = words.into_iter().take(2).chain(["--help-effects".into()]);
            (topic, effects.collect())
        }
        _ => (topic, words),
    }
}

/// Parses the arguments. Help is a line or two an option, for `--help` as for `-h`; options that
/// few need are those of `--help all`.
fn parse(words: &[String]) -> Program {
    let (topic, typed) = help_topic(std::env::args_os().collect());
    let shows_all = topic.is_some_and(|topic| topic == "all");
    let help = |mut command: Clap| {
        let has_more = command.get_arguments().any(Arg::is_hide_short_help_set);
        if shows_all {
            command = command.mut_args(|argument| {
                let whole = argument.get_long_help().map(|help| help.to_string());
                let whole = whole.map(|help| help.replace("\n\n", "; "));
                let argument = argument.hide_short_help(false);
                match whole {
                    Some(whole) => argument.help(whole),
                    None => argument,
                }
            });
        }
        let has_effects = command.get_arguments().any(|own| own.get_id() == "help_effects");
        let about = match (has_more, has_effects) {
            (true, true) => "Print help; all options: --help all; effects: --help effects",
            (true, false) => "Print help; all options: --help all",
            _ => "Print help",
        };
        let help = Arg::new("help").short('h').long("help").action(ArgAction::HelpShort);
        command.disable_help_flag(true).arg(help.help(about))
    };
    let mut program = help(Program::command()).mut_subcommands(help);
    let parsed = program.try_get_matches_from_mut(typed);
    let parsed = parsed.and_then(|matches| Program::from_arg_matches(&matches));
    parsed.unwrap_or_else(|error| end(&suggestions::suggest(error, &program, words)))
}

/// Prints help, or an error of usage, and ends the program. Help that cannot be written is an
/// error; a closed pipe is none.
fn end(error: &clap::Error) -> ! {
    let printed = error.print().and_then(|()| std::io::stdout().flush());
    let code = match printed {
        Err(failed) if !error.use_stderr() && failed.kind() != ErrorKind::BrokenPipe => {
            say(&format!("cannot write standard output: {failed}"));
            1
        }
        _ => error.exit_code(),
    };
    std::process::exit(code)
}

fn main() -> ExitCode {
    pointillist::cloud::catch_panic::hide_caught_panics();
    // Errors only if there is a logger already, which there is not.
    if log::set_logger(&Logger).is_ok() {
        log::set_max_level(log::LevelFilter::Error);
    }
    let arguments: Vec<String> =
        std::env::args_os().skip(1).map(|word| word.to_string_lossy().into_owned()).collect();
    let program = parse(&arguments);
    renamed::notes(&arguments).iter().for_each(|note| say(&format!("note: {note}")));
    let progress = Terminal::new();
    let done = thread_pool::start().and_then(|()| match &program.command {
        Command::View(arguments) => view::run(arguments, &progress),
        Command::Render(arguments) => render::run(arguments, &progress),
        Command::Index(arguments) => index::run(arguments, &progress),
        Command::Shadows(arguments) => shadows::run(arguments, &progress),
        Command::Export(arguments) => export::run(arguments, &progress),
        Command::Raster(arguments) => raster::run(arguments, &progress),
        Command::Info(arguments) => info::run(arguments, &progress),
        Command::Profile(arguments) => profile::run(arguments, &progress),
        Command::Synth(arguments) => synth::run(arguments, &progress),
        Command::Tune(arguments) => tune::run(arguments, &progress),
        Command::Study(arguments) => study::run(arguments, &progress),
        Command::Bench(arguments) => bench::run(arguments, &progress),
        Command::Guide(arguments) => guide::run(arguments),
    });
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(Error::Interrupted) => {
            say(&Error::Interrupted.to_string());
            ExitCode::from(130)
        }
        Err(error) => {
            // One line, whatever a path contains; only validation messages have several.
            match error {
                Error::Validation(_) => say(&error.to_string()),
                _ => say(&error.to_string().replace('\n', "\\n")),
            }
            ExitCode::FAILURE
        }
    }
}
