//! What Relume's end-to-end tests share: [`host`], our own OpenFX host, and the ways to the built products.

pub mod host;

use std::env;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

/// The folder of the workspace.
///
/// # Panics
/// When this package is not inside one.
pub fn workspace_root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the package is inside the workspace").to_path_buf()
}

/// The optional folder of real photographs beside the workspace; `None` when it is not there, and then a test that needs
/// it prints [`skipped`].
pub fn shared_data() -> Option<PathBuf> {
    let data = workspace_root().join("../shared/data");
    data.is_dir().then_some(data)
}

/// Says that a test was skipped, and why.
#[expect(clippy::print_stderr, reason = "the only voice a test has")]
pub fn skipped(what: &str) {
    eprintln!("skipped: {what} absent");
}

fn cargo(arguments: &[&str]) {
    let cargo = env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let status = Command::new(cargo).args(arguments).current_dir(workspace_root()).status();
    let status = status.expect("cargo can be run");
    assert!(status.success(), "cargo {} failed", arguments.join(" "));
}

/// Where cargo puts what it builds.
pub fn target_dir() -> PathBuf {
    let given = env::var_os("CARGO_TARGET_DIR").map(PathBuf::from);
    workspace_root().join(given.unwrap_or_else(|| "target".into()))
}

/// The OpenFX bundle, built on the first call (`cargo xtask bundle`).
///
/// # Panics
/// When it cannot be built.
pub fn bundle() -> PathBuf {
    static BUNDLE: OnceLock<PathBuf> = OnceLock::new();
    let build = || {
        cargo(&["run", "-q", "-p", "xtask", "--", "bundle"]);
        let bundle = target_dir().join("Relume.ofx.bundle");
        assert!(bundle.is_dir(), "xtask made no {}", bundle.display());
        bundle
    };
    BUNDLE.get_or_init(build).clone()
}

/// The command-line tool, built on the first call (dev profile).
///
/// # Panics
/// When it cannot be built.
pub fn relume() -> PathBuf {
    static RELUME: OnceLock<PathBuf> = OnceLock::new();
    let build = || {
        // Of the whole workspace, as the tests themselves: dependencies then have the same features and are built once.
        cargo(&["build", "-q", "--workspace", "--bins"]);
        target_dir().join("debug").join(format!("relume{}", env::consts::EXE_SUFFIX))
    };
    RELUME.get_or_init(build).clone()
}

/// Runs a test alone in a process of its own, for what counts threads or reads the environment: in the test's process
/// runs the test named `name` (`module::function`) again in a child, and in the child the body.
///
/// # Panics
/// When the body fails in the child.
pub fn alone(name: &str, body: impl FnOnce()) {
    const MARK: &str = "RELUME_TEST_ALONE";
    if env::var_os(MARK).is_some() {
        return body();
    }
    let this = env::current_exe().expect("a test knows its own path");
    let output = Command::new(this).args([name, "--exact", "--nocapture", "--test-threads=1"]).env(MARK, "1").output();
    let output = output.expect("a test can run itself");
    let said = String::from_utf8_lossy(&output.stdout);
    let complained = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && said.contains("1 passed"), "{name} alone:\n{said}\n{complained}");
}
