//! A command that takes a photograph.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use crate::devices::{Finding, Trouble};
use crate::progress;
use crate::session::Exposure;

/// Between two looks whether it has ended.
const LOOK: Duration = Duration::from_millis(20);
/// Of what it complains so many bytes are told, its last ones.
const TOLD: usize = 500;

/// A command: the program and its arguments, without a shell.
#[derive(Debug, Clone)]
pub struct Trigger {
    words: Vec<String>,
}

impl Trigger {
    /// None where the operator takes the photographs.
    ///
    /// # Errors
    /// A place for a number that is not known.
    pub fn new(words: &[String]) -> Result<Option<Self>, Trouble> {
        let Some(program) = words.first() else { return Ok(None) };
        for word in words {
            let left =
                ["{time_s}", "{iso}", "{f_number}"].iter().fold(word.clone(), |word, known| word.replace(known, ""));
            if let Some(unknown) = left.find('{').filter(|from| left[*from..].contains('}')) {
                let what = format!("the camera's trigger {program} has {} in it", &left[unknown..]);
                return Err(Trouble::stop(what, "{time_s}, {iso} and {f_number} are put in, nothing else"));
            }
        }
        Ok(Some(Self { words: words.to_vec() }))
    }

    /// Is the program there?
    pub fn preflight(&self) -> Finding {
        let program = &self.words[0];
        match found(program) {
            Some(path) => Finding::fine(format!("camera: triggered by {}", path.display())),
            None => Finding::missing(format!("camera: its trigger {program} is not there; correct it in the rig file")),
        }
    }

    /// Runs it to its end.
    ///
    /// # Errors
    /// It cannot be started, fails, takes longer than `limit`; a request to stop.
    pub fn run(&self, exposure: &Exposure, limit: Duration) -> Result<(), Trouble> {
        let words: Vec<String> = self.words.iter().map(|word| put_in(word, exposure)).collect();
        let told = format!("the camera's trigger `{}`", words.join(" "));
        let started = Command::new(&words[0])
            .args(&words[1..])
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn();
        let mut child = started.map_err(|error| {
            Trouble::stop(format!("{told} cannot be started: {error}"), "correct trigger in the rig file")
        })?;
        // Read beside: a pipe that fills up would stop the program.
        let complaints = child.stderr.take().map(|mut pipe| {
            std::thread::spawn(move || {
                let mut bytes = Vec::new();
                let _ = pipe.read_to_end(&mut bytes);
                String::from_utf8_lossy(&bytes[bytes.len().saturating_sub(TOLD)..]).trim().replace('\n', "; ")
            })
        });
        let status = finish(&mut child, limit)?;
        let Some(status) = status else {
            let what = format!("{told} did not end within {} s", limit.as_secs_f64().round());
            return Err(Trouble::stop(what, "try it by hand; a larger within_s in the rig file waits longer"));
        };
        if status.success() {
            return Ok(());
        }
        let said = complaints.and_then(|thread| thread.join().ok()).filter(|said| !said.is_empty());
        let said = said.map_or_else(|| "it said nothing".to_owned(), |said| format!("it said: {said}"));
        Err(Trouble::stop(format!("{told} ended with {status}; {said}"), "try it by hand"))
    }
}

/// Waits for the end; none where it takes too long, and then it is ended.
fn finish(child: &mut Child, limit: Duration) -> Result<Option<ExitStatus>, Trouble> {
    let begun = Instant::now();
    loop {
        match child.try_wait() {
            Ok(Some(status)) => return Ok(Some(status)),
            Ok(None) if begun.elapsed() < limit => {}
            _ => {
                end(child);
                return Ok(None);
            }
        }
        if let Err(asked) = progress::check_urgent() {
            end(child);
            return Err(asked.into());
        }
        std::thread::sleep(LOOK);
    }
}

fn end(child: &mut Child) {
    let _ = child.kill();
    let _ = child.wait();
}

/// With the numbers of an exposure; those that are not known are left empty.
fn put_in(word: &str, exposure: &Exposure) -> String {
    let number = |value: Option<f64>| value.map_or_else(String::new, |value| value.to_string());
    word.replace("{time_s}", &exposure.time_s.to_string())
        .replace("{iso}", &number(exposure.iso))
        .replace("{f_number}", &number(exposure.f_number))
}

/// Where a program lies: at its path, or in one of PATH's folders.
fn found(program: &str) -> Option<PathBuf> {
    let path = Path::new(program);
    if path.components().count() > 1 {
        return path.is_file().then(|| path.to_path_buf());
    }
    let folders = std::env::var_os("PATH")?;
    let names = [program.to_owned(), format!("{program}{}", std::env::consts::EXE_SUFFIX)];
    std::env::split_paths(&folders)
        .flat_map(|folder| names.iter().map(move |name| folder.join(name)))
        .find(|path| path.is_file())
}

#[cfg(test)]
mod tests {
    use super::*;

    const EXPOSURE: Exposure = Exposure { time_s: 0.0125, iso: Some(100.0), f_number: None };

    fn trigger(words: &[&str]) -> Trigger {
        let words: Vec<String> = words.iter().map(|word| (*word).to_owned()).collect();
        Trigger::new(&words).unwrap().unwrap()
    }

    #[test]
    fn numbers_are_put_in() {
        assert_eq!(put_in("--time={time_s}:{iso}:{f_number}", &EXPOSURE), "--time=0.0125:100:");
        let words = ["snap".to_owned(), "--speed={speed}".to_owned()];
        let Err(Trouble::Stop { what, advice }) = Trigger::new(&words) else { panic!() };
        assert!(what.contains("{speed}") && advice.contains("{time_s}"), "{what}; {advice}");
        assert!(Trigger::new(&[]).unwrap().is_none());
    }

    #[cfg(unix)]
    #[test]
    fn commands_that_fail_are_told() {
        let run = |words: &[&str], limit_s: f64| match trigger(words).run(&EXPOSURE, Duration::from_secs_f64(limit_s)) {
            Err(Trouble::Stop { what, .. }) => what,
            other => panic!("{other:?}"),
        };
        trigger(&["true"]).run(&EXPOSURE, Duration::from_secs(5)).unwrap();
        let said = run(&["sh", "-c", "echo no card >&2; echo in the camera >&2; exit 3"], 5.0);
        assert!(said.contains("exit status: 3") && said.contains("no card; in the camera"), "{said}");
        assert!(run(&["relume-no-such-program"], 5.0).contains("cannot be started"));
        assert!(run(&["sleep", "10"], 0.1).contains("did not end within"));
        // More than a pipe holds.
        assert!(run(&["sh", "-c", "head -c 300000 /dev/zero | tr '\\0' 'x' >&2; exit 1"], 10.0).contains("xxx"));
        assert!(trigger(&["sh"]).preflight().fine);
        assert!(!trigger(&["relume-no-such-program"]).preflight().fine);
    }
}
