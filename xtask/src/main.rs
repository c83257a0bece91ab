//! Project chores: `cargo xtask bundle`, `cargo xtask install`.

mod bundle;
mod folders;

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use clap::{Args, Parser, Subcommand};

/// Chores of the project: builds and installs the OpenFX bundle.
#[derive(Parser)]
#[command(name = "cargo xtask", bin_name = "cargo xtask")]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Builds Relume.ofx.bundle into the target folder and prints where it is.
    #[command(after_help = "Example:\n  cargo xtask bundle --release\n\n\
        The bundle goes to target/Relume.ofx.bundle ($CARGO_TARGET_DIR/Relume.ofx.bundle where that is set). To try it \
        without installing it, start the host with OFX_PLUGIN_PATH set to that folder.")]
    Bundle(BundleArgs),
    /// Builds the bundle, optimised, and copies it to where hosts look for plug-ins.
    #[command(
        after_help = "Examples:\n  cargo xtask install --to ~/OFX\n  sudo -E env PATH=\"$PATH\" cargo xtask install\n\n\
        The default folder is that of the system: /usr/OFX/Plugins on Linux, /Library/OFX/Plugins on macOS, \
        C:\\Program Files\\Common Files\\OFX\\Plugins on Windows; writing there needs an administrator. Hosts also look \
        in the folders that OFX_PLUGIN_PATH lists. A bundle that is already there is replaced; close the hosts first."
    )]
    Install(InstallArgs),
}

#[derive(Args)]
struct BundleArgs {
    /// Builds with the release profile (fastest code, slow to build).
    #[arg(long)]
    release: bool,
}

#[derive(Args)]
struct InstallArgs {
    /// Folder that gets Relume.ofx.bundle; made if absent.
    #[arg(long, value_name = "DIR")]
    to: Option<PathBuf>,
    /// Installs the development build instead of the release build.
    #[arg(long)]
    dev: bool,
}

#[expect(clippy::print_stdout, reason = "the path is the answer of the command")]
fn main() -> Result<()> {
    match Cli::parse().command {
        Command::Bundle(args) => println!("{}", bundle::build(args.release)?.display()),
        Command::Install(args) => println!("{}", install(&args)?.display()),
    }
    Ok(())
}

fn install(args: &InstallArgs) -> Result<PathBuf> {
    let folder = match &args.to {
        Some(folder) => folder.clone(),
        None => default_folder()?,
    };
    let bundle = bundle::build(!args.dev)?;
    install_from(&bundle, &folder).with_context(|| {
        format!("cannot install into {}; run as administrator, or choose a folder with --to DIR", folder.display())
    })
}

fn install_from(bundle: &Path, folder: &Path) -> Result<PathBuf> {
    std::fs::create_dir_all(folder)?;
    let target = folder.join(bundle::NAME);
    folders::replace(&target, |fresh| folders::copy(bundle, fresh))?;
    Ok(target)
}

/// Where the standard says that hosts look.
fn default_folder() -> Result<PathBuf> {
    Ok(PathBuf::from(match std::env::consts::OS {
        "linux" => "/usr/OFX/Plugins",
        "macos" => "/Library/OFX/Plugins",
        "windows" => r"C:\Program Files\Common Files\OFX\Plugins",
        other => bail!("OpenFX has no plug-in folder for {other}; choose one with --to DIR"),
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        use clap::CommandFactory;
        Cli::command().debug_assert();
    }

    #[test]
    fn installing_replaces_what_was_there() {
        let folder = tempfile::tempdir().unwrap();
        let source = folder.path().join("built").join(bundle::NAME);
        std::fs::create_dir_all(source.join("Contents")).unwrap();
        std::fs::write(source.join("Contents/Info.plist"), "new").unwrap();
        let to = folder.path().join("OFX/Plugins");
        std::fs::create_dir_all(to.join(bundle::NAME).join("Contents/Old")).unwrap();
        let installed = install_from(&source, &to).unwrap();
        assert_eq!(std::fs::read_to_string(installed.join("Contents/Info.plist")).unwrap(), "new");
        assert!(!installed.join("Contents/Old").exists());
        let left: Vec<_> = std::fs::read_dir(&to).unwrap().map(|e| e.unwrap().file_name()).collect();
        assert_eq!(left, [bundle::NAME], "nothing half-made stays behind");
    }
}
