//! Boards without hardware, from outside: `relume rig simulate`, whatever is plugged into it, and what the world behind it shows.

use std::fs;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

use super::capture::tool;

/// More than a machine under load needs for anything that is waited for here.
const LONG: Duration = Duration::from_secs(30);

/// The simulator of a rig, until it is dropped.
pub(crate) struct Simulated {
    child: Child,
    pub(crate) folder: tempfile::TempDir,
}

impl Simulated {
    /// Of a rig file in which `{dir}` stands for the folder of the ports.
    pub(crate) fn start(rig: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let at = folder.path().display().to_string();
        fs::write(folder.path().join("rig.toml"), rig.replace("{dir}", &at)).unwrap();
        let mut command = tool("rig");
        command.arg("simulate").arg(folder.path().join("rig.toml")).arg("--at").arg(folder.path());
        let mut child = command.stdout(Stdio::piped()).spawn().unwrap();
        let lines = BufReader::new(child.stdout.take().unwrap()).lines();
        let ready = lines.map_while(Result::ok).find(|line| line.contains("ready"));
        assert!(ready.is_some(), "the simulator never said that it is ready");
        Self { child, folder }
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// A command of the tool that takes the rig file.
    pub(crate) fn with_rig(&self, words: &[&str]) -> Command {
        let mut command = tool(words[0]);
        command.args(&words[1..]).arg(self.path("rig.toml"));
        command
    }

    /// `relume capture` into a session.
    pub(crate) fn capture(&self, session: &str, options: &[&str]) -> Command {
        let mut command = self.with_rig(&["capture"]);
        command.arg("--session").arg(self.path(session)).args(options);
        command
    }

    /// What the world is like now.
    pub(crate) fn state(&self) -> Value {
        serde_json::from_str(&fs::read_to_string(self.path("state.json")).unwrap()).unwrap()
    }

    /// Lamps that are lit.
    pub(crate) fn lit(&self) -> usize {
        self.state()["levels"].as_object().map_or(0, serde_json::Map::len)
    }

    /// Waits for lamps to be lit, or to be out; says how long that took.
    pub(crate) fn wait_for_lamps(&self, lit: bool) -> Duration {
        let begun = Instant::now();
        while (self.lit() > 0) != lit {
            assert!(begun.elapsed() < LONG, "lamps: {}", self.state());
            std::thread::sleep(Duration::from_millis(5));
        }
        begun.elapsed()
    }
}

impl Drop for Simulated {
    fn drop(&mut self) {
        signal(&self.child, "TERM");
        let _ = self.child.wait();
    }
}

/// Sends a signal to a process.
pub(crate) fn signal(child: &Child, name: &str) {
    let status = Command::new("kill").arg(format!("-{name}")).arg(child.id().to_string()).status();
    assert!(status.is_ok_and(|status| status.success()), "kill -{name}");
}

/// The photographs of a session.
pub(crate) fn photographs(session: &Path) -> usize {
    let journal = fs::read_to_string(session.join("journal.jsonl")).unwrap_or_default();
    journal.lines().filter(|line| line.contains("\"photograph\"")).count()
}
