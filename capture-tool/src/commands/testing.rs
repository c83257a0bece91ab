//! What the tests of the commands share.

use clap::{Args, Parser};

#[derive(Debug, Parser)]
struct Line<A: Args> {
    #[command(flatten)]
    arguments: A,
}

/// The flags of a command, from a line whose first word is its name.
pub fn parse<A: Args>(line: &str) -> Result<A, clap::Error> {
    Line::try_parse_from(line.split_whitespace()).map(|line: Line<A>| line.arguments)
}
