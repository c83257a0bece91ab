//! Folders that appear whole or not at all.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

/// Makes `target` anew: `fill` gets an empty folder beside it, which then takes its place by renaming. If that holds the
/// same files as before, the old folder stays untouched, so that a host that has it loaded is not disturbed. On any error
/// the old folder is still there.
pub fn replace(target: &Path, fill: impl FnOnce(&Path) -> Result<()>) -> Result<()> {
    let (fresh, old) = (beside(target, "new")?, beside(target, "old")?);
    for left_over in [&fresh, &old] {
        remove(left_over)?;
    }
    fs::create_dir(&fresh).with_context(|| format!("cannot make {}", fresh.display()))?;
    let swapped = fill(&fresh).and_then(|()| {
        if target.exists() && same(&fresh, target)? {
            return Ok(());
        }
        swap(&fresh, target, &old)
    });
    remove(&fresh).and(remove(&old)).and(swapped)
}

fn swap(fresh: &Path, target: &Path, old: &Path) -> Result<()> {
    if target.exists() {
        fs::rename(target, old).with_context(|| format!("cannot replace {}", target.display()))?;
    }
    let renamed = fs::rename(fresh, target);
    if renamed.is_err() && old.exists() {
        // Nothing better can be done if this fails as well; the error that counts is the first.
        let _ = fs::rename(old, target);
    }
    renamed.with_context(|| format!("cannot write {}", target.display()))
}

/// Copies a folder and what is in it.
pub fn copy(from: &Path, to: &Path) -> Result<()> {
    for name in names(from)? {
        let (source, copy) = (from.join(&name), to.join(&name));
        if source.is_dir() {
            fs::create_dir(&copy).with_context(|| format!("cannot make {}", copy.display()))?;
            self::copy(&source, &copy)?;
        } else {
            fs::copy(&source, &copy)
                .with_context(|| format!("cannot copy {} to {}", source.display(), copy.display()))?;
        }
    }
    Ok(())
}

/// A hidden neighbour that no other run uses: renaming works only within one file system.
fn beside(target: &Path, purpose: &str) -> Result<PathBuf> {
    let name = target.file_name().with_context(|| format!("{} has no name", target.display()))?;
    Ok(target.with_file_name(format!(".{}.{}.{purpose}", name.to_string_lossy(), std::process::id())))
}

fn remove(folder: &Path) -> Result<()> {
    if folder.exists() {
        fs::remove_dir_all(folder).with_context(|| format!("cannot remove {}", folder.display()))?;
    }
    Ok(())
}

/// Do two folders hold the same names and bytes?
fn same(a: &Path, b: &Path) -> Result<bool> {
    if a.is_dir() != b.is_dir() {
        return Ok(false);
    }
    if !a.is_dir() {
        return Ok(fs::read(a)? == fs::read(b)?);
    }
    let entries = names(a)?;
    if entries != names(b)? {
        return Ok(false);
    }
    for name in entries {
        if !same(&a.join(&name), &b.join(&name))? {
            return Ok(false);
        }
    }
    Ok(true)
}

fn names(folder: &Path) -> Result<Vec<std::ffi::OsString>> {
    let entries = fs::read_dir(folder).with_context(|| format!("cannot list {}", folder.display()))?;
    let mut names = entries.map(|entry| Ok(entry?.file_name())).collect::<Result<Vec<_>>>()?;
    names.sort();
    Ok(names)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failing_fill_leaves_the_old_folder_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("X.bundle");
        fs::create_dir(&target).unwrap();
        fs::write(target.join("a"), "old").unwrap();
        let failed = replace(&target, |fresh| {
            fs::write(fresh.join("a"), "half")?;
            anyhow::bail!("disk full")
        });
        assert!(failed.is_err());
        assert_eq!(fs::read_to_string(target.join("a")).unwrap(), "old");
        assert_eq!(names(folder.path()).unwrap(), ["X.bundle"]);
    }

    #[test]
    fn an_equal_folder_is_not_touched() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("X.bundle");
        let fill = |text: &'static str| move |fresh: &Path| Ok(fs::write(fresh.join("a"), text)?);
        let modified = || fs::metadata(target.join("a")).unwrap().modified().unwrap();
        replace(&target, fill("one")).unwrap();
        let before = modified();
        std::thread::sleep(std::time::Duration::from_millis(20));
        replace(&target, fill("one")).unwrap();
        assert_eq!(modified(), before);
        replace(&target, fill("two")).unwrap();
        assert_ne!(modified(), before);
        assert_eq!(fs::read_to_string(target.join("a")).unwrap(), "two");
        assert_eq!(names(folder.path()).unwrap(), ["X.bundle"]);
    }
}
