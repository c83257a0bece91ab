//! `relume`: captures objects under one light after another, relights them, and looks after `.rfield` files.
//!
//! Each command goes from raw flags to a checked plan to the work, and returns what is to be said; this file says it and
//! chooses the exit code: 0, 1 bad input, 2 usage, 130 stopped with Ctrl-C.

#![deny(unsafe_code)]

mod capture;
mod commands;
mod devices;
mod drawing;
mod frames;
mod new_folder;
mod pack;
mod progress;
mod projection;
mod rigs;
mod session;
mod sheet;
#[cfg(unix)]
mod simulators;
mod watchdog;

use std::io::Write;
use std::process::ExitCode;

use clap::Parser;

/// What a shell reports for a program that Ctrl-C ended: 128 + SIGINT.
const EXIT_STOPPED: u8 = 130;

/// Relights objects that were photographed under one lamp at a time.
#[derive(Debug, Parser)]
#[command(name = "relume", version, max_term_width = 100, after_help = AFTER_HELP)]
struct Arguments {
    #[command(subcommand)]
    command: commands::Command,
}

const AFTER_HELP: &str = "\
Example:
  relume demo
  relume import lp photographs/dirs.lp -o vase.rfield
  relume relight vase.rfield --env park.hdr -o vase.exr

Exit codes: 0 done, 1 bad input, 2 wrong usage, 130 stopped with Ctrl-C.";

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    progress::listen_for_ctrl_c();
    let said = match arguments.command.run() {
        Ok(text) => std::io::stdout().lock().write_all(text.as_bytes()),
        Err(error) if progress::is_cancelled(&error) => {
            complain("stopped; nothing unfinished was left behind");
            return ExitCode::from(EXIT_STOPPED);
        }
        Err(error) => {
            complain(&format!("error: {}", with_causes(&error)));
            return ExitCode::FAILURE;
        }
    };
    match said {
        // Who closes our pipe (`relume info a.rfield | head`) has seen enough.
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            complain(&format!("error: cannot write to the standard output: {error}"));
            ExitCode::FAILURE
        }
        _ => ExitCode::SUCCESS,
    }
}

/// One line on stderr. When even that is closed there is nobody left to tell.
fn complain(line: &str) {
    let _ = writeln!(std::io::stderr().lock(), "{line}");
}

/// An error and its causes as one sentence. A cause whose words the sentence ends with already is not repeated.
fn with_causes(error: &anyhow::Error) -> String {
    let mut causes = error.chain().map(ToString::to_string);
    let first = causes.next().unwrap_or_default();
    causes.fold(first, |said, cause| if said.ends_with(&cause) { said } else { format!("{said}: {cause}") })
}

#[cfg(test)]
mod tests {
    use anyhow::Context;
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_definition_of_the_command_line_is_sound() {
        Arguments::command().debug_assert();
    }

    #[test]
    fn every_command_has_help_with_an_example() {
        fn visit(command: &clap::Command) {
            let leaf = command.get_subcommands().next().is_none();
            if leaf {
                let after = command.get_after_help().map(ToString::to_string).unwrap_or_default();
                assert!(after.contains("Example"), "{} has no example", command.get_name());
                assert!(command.get_about().is_some(), "{} has no description", command.get_name());
                let bare = command.get_arguments().find(|a| a.get_help().is_none() && a.get_id() != "help");
                assert!(bare.is_none(), "{}: {bare:?} has no help", command.get_name());
            }
            command.get_subcommands().for_each(visit);
        }
        visit(&Arguments::command());
    }

    #[test]
    fn examples_in_the_help_parse() {
        fn visit(command: &clap::Command) {
            let after = command.get_after_help().map(ToString::to_string).unwrap_or_default();
            for example in after.lines().filter_map(|line| line.trim().strip_prefix("relume ")) {
                let words = std::iter::once("relume").chain(example.split_whitespace());
                assert!(Arguments::try_parse_from(words).is_ok(), "relume {example}");
            }
            command.get_subcommands().for_each(visit);
        }
        visit(&Arguments::command());
    }

    #[test]
    fn causes_are_said_once() {
        let io = std::io::Error::other("disk on fire");
        let error = anyhow::Error::new(relume_core::Error::io("read", "a.exr", io)).context("cannot compare");
        assert_eq!(with_causes(&error), "cannot compare: cannot read a.exr: disk on fire");
        let nested: anyhow::Result<()> = Err(anyhow::anyhow!("inner")).context("outer");
        assert_eq!(with_causes(&nested.unwrap_err()), "outer: inner");
    }
}
