//! `relume devices`: what is connected, and what it can do.

use clap::Args;

use crate::devices::{cameras, displays, port};

const EXAMPLES: &str = "\
Example:
  relume devices

The names are what rig files take: a camera's `model` and `port`, a board's `port`, a screen's `output`. Then: relume rig new,
relume rig check RIG.toml.";

/// No flags.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {}

impl Arguments {
    /// Looks and lists; opens no serial port, since that restarts many boards.
    ///
    /// # Errors
    /// None: what cannot be looked at is said in its place.
    pub fn run(self) -> anyhow::Result<String> {
        let parts = [("cameras", cameras::list()), ("serial ports", port::list()), ("screens", displays::list())];
        Ok(parts.iter().map(|(what, lines)| section(what, lines)).collect::<Vec<_>>().join("\n"))
    }
}

fn section(what: &str, lines: &[String]) -> String {
    let lines: String = lines.iter().map(|line| format!("  {line}\n")).collect();
    if lines.is_empty() { format!("{what}\n  none\n") } else { format!("{what}\n{lines}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_is_said_to_be_nothing() {
        assert_eq!(section("cameras", &[]), "cameras\n  none\n");
        assert_eq!(section("screens", &["HDMI-1".to_owned(), "DP-2".to_owned()]), "screens\n  HDMI-1\n  DP-2\n");
    }
}
