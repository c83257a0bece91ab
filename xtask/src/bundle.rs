//! `Relume.ofx.bundle`: the folder that hosts load.
//!
//! Layout (OpenFX Programming Reference, "Packaging OFX Plug-ins"): `Contents/Info.plist`, `Contents/Resources/`,
//! `Contents/ARCH/Relume.ofx`. The file must bear the bundle's name. Only this machine's architecture is built; a
//! universal macOS bundle needs the outputs of two machines joined with `lipo`.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, Result, bail};
use serde_json::Value;

use crate::folders;

/// The bundle's folder.
pub const NAME: &str = "Relume.ofx.bundle";
/// The library inside.
const LIBRARY: &str = "Relume.ofx";
const PACKAGE: &str = "relume-ofx";

/// Builds the library with cargo and lays out the bundle in the target folder; returns where it is.
pub fn build(release: bool) -> Result<PathBuf> {
    let library = library(release)?;
    let target = target_folder()?;
    fs::create_dir_all(&target).with_context(|| format!("cannot make {}", target.display()))?;
    let bundle = target.join(NAME);
    // Tests ask for the bundle at the same time: one after the other.
    let lock_path = target.join(format!(".{NAME}.lock"));
    let lock = File::create(&lock_path).with_context(|| format!("cannot write {}", lock_path.display()))?;
    lock.lock().with_context(|| format!("cannot lock {}", lock_path.display()))?;
    folders::replace(&bundle, |fresh| fill(fresh, &library))?;
    Ok(bundle)
}

fn fill(bundle: &Path, library: &Path) -> Result<()> {
    let contents = bundle.join("Contents");
    let binaries = contents.join(architecture()?);
    let resources = contents.join("Resources");
    for folder in [&binaries, &resources] {
        fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    }
    fs::write(contents.join("Info.plist"), info_plist())?;
    let copied = binaries.join(LIBRARY);
    fs::copy(library, &copied).with_context(|| format!("cannot copy {}", library.display()))?;
    for resource in resource_files()? {
        let name = resource.file_name().context("a resource without a name")?;
        fs::copy(&resource, resources.join(name)).with_context(|| format!("cannot copy {}", resource.display()))?;
    }
    Ok(())
}

/// Icons of the effects, our licence, and those of others that ask to go with the binary.
fn resource_files() -> Result<Vec<PathBuf>> {
    let root = root()?;
    let mut files = Vec::new();
    for folder in [root.join("plugin/resources"), root.join("licenses"), root.clone()] {
        let ours_only = folder == root;
        for entry in fs::read_dir(&folder).with_context(|| format!("cannot list {}", folder.display()))? {
            let path = entry?.path();
            let begins = |with: &str| path.file_name().is_some_and(|n| n.to_string_lossy().starts_with(with));
            let wanted = if ours_only { begins("LICENSE") } else { !begins("README") };
            if path.is_file() && wanted {
                files.push(path);
            }
        }
    }
    files.sort();
    Ok(files)
}

/// The folder of this machine's binaries.
fn architecture() -> Result<&'static str> {
    match (std::env::consts::OS, std::env::consts::ARCH) {
        ("linux", "x86_64") => Ok("Linux-x86-64"),
        ("linux", "aarch64") => Ok("Linux-aarch64"),
        ("windows", "x86_64") => Ok("Win64"),
        ("macos", _) => Ok("MacOS"),
        (os, arch) => bail!("OpenFX has no folder for {os} on {arch}"),
    }
}

fn info_plist() -> String {
    let version = env!("CARGO_PKG_VERSION");
    format!(
        r#"<?xml version="1.0" encoding="UTF-8"?>
<!DOCTYPE plist PUBLIC "-//Apple//DTD PLIST 1.0//EN" "http://www.apple.com/DTDs/PropertyList-1.0.dtd">
<plist version="1.0">
<dict>
    <key>CFBundleDevelopmentRegion</key>
    <string>English</string>
    <key>CFBundleExecutable</key>
    <string>{LIBRARY}</string>
    <key>CFBundleIdentifier</key>
    <string>org.relume.Relume</string>
    <key>CFBundleInfoDictionaryVersion</key>
    <string>6.0</string>
    <key>CFBundleName</key>
    <string>Relume</string>
    <key>CFBundlePackageType</key>
    <string>BNDL</string>
    <key>CFBundleShortVersionString</key>
    <string>{version}</string>
    <key>CFBundleVersion</key>
    <string>{version}</string>
</dict>
</plist>
"#
    )
}

/// Builds the library and asks cargo where it put it.
fn library(release: bool) -> Result<PathBuf> {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let mut command = Command::new(cargo);
    // Development builds are of the whole workspace, as `cargo test` builds it: dependencies then have the same features and are
    // built once.
    let what: &[&str] = if release { &["--package", PACKAGE] } else { &["--workspace"] };
    command.current_dir(root()?).args(["build", "--lib"]).args(what);
    command.arg("--message-format=json-render-diagnostics").stderr(Stdio::inherit());
    if let Some(folder) = std::env::var_os("CARGO_TARGET_DIR") {
        // Cargo would take a relative one from the folder it is started in, which is no longer the caller's.
        command.env("CARGO_TARGET_DIR", std::path::absolute(folder)?);
    }
    if release {
        command.arg("--release");
    }
    let output = command.output().context("cannot start cargo")?;
    if !output.status.success() {
        bail!("cargo could not build {PACKAGE}");
    }
    artefact(&String::from_utf8_lossy(&output.stdout)).context("cargo built no library")
}

/// The dynamic library among cargo's messages.
fn artefact(messages: &str) -> Option<PathBuf> {
    let messages = messages.lines().filter_map(|line| serde_json::from_str::<Value>(line).ok());
    let ours = messages.filter(|m| m["reason"] == "compiler-artifact" && m["target"]["name"] == "relume_ofx");
    let files = ours.flat_map(|m| m["filenames"].as_array().cloned().unwrap_or_default());
    let paths = files.filter_map(|f| f.as_str().map(PathBuf::from)).collect::<Vec<_>>();
    paths.into_iter().rfind(|p| p.extension().is_some_and(|e| e == std::env::consts::DLL_EXTENSION))
}

/// The workspace.
fn root() -> Result<PathBuf> {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    Ok(here.parent().context("xtask lies in no workspace")?.to_owned())
}

fn target_folder() -> Result<PathBuf> {
    match std::env::var_os("CARGO_TARGET_DIR") {
        Some(folder) => Ok(std::path::absolute(folder)?),
        None => Ok(root()?.join("target")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bundle_has_the_layout_of_the_standard() {
        let folder = tempfile::tempdir().unwrap();
        let library = folder.path().join("librelume_ofx.so");
        fs::write(&library, "code").unwrap();
        let bundle = folder.path().join(NAME);
        fs::create_dir(&bundle).unwrap();
        fill(&bundle, &library).unwrap();
        let contents = bundle.join("Contents");
        let binary = contents.join(architecture().unwrap()).join(LIBRARY);
        assert_eq!(fs::read_to_string(binary).unwrap(), "code");
        let plist = fs::read_to_string(contents.join("Info.plist")).unwrap();
        assert!(plist.contains("<string>Relume.ofx</string>") && plist.contains("<string>BNDL</string>"));
        for resource in ["org.relume.Relight.png", "org.relume.EnvironmentMatte.png", "openfx.md"] {
            assert!(contents.join("Resources").join(resource).is_file(), "{resource}");
        }
    }

    #[test]
    fn the_library_is_found_among_the_messages() {
        let extension = std::env::consts::DLL_EXTENSION;
        let other =
            r#"{"reason":"compiler-artifact","target":{"name":"relume_core"},"filenames":["/t/librelume_core.rlib"]}"#;
        let ours = format!(
            r#"{{"reason":"compiler-artifact","target":{{"name":"relume_ofx"}},"filenames":["/t/librelume_ofx.{extension}"]}}"#
        );
        let messages = format!("{other}\nnot json\n{ours}\n{{\"reason\":\"build-finished\",\"success\":true}}\n");
        assert_eq!(artefact(&messages), Some(PathBuf::from(format!("/t/librelume_ofx.{extension}"))));
        assert_eq!(artefact(other), None);
    }
}
