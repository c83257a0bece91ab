//! Exposure times given by hand.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use relume_core::hdr::{Exposure, parse_time};

use super::file_name;

/// More than this is no list of times.
const LARGEST_FILE: u64 = 1 << 20;

/// A list of times, each with the name of its photograph where it was given.
#[derive(Debug)]
pub(super) struct Times {
    place: String,
    times: Vec<(Option<String>, f64)>,
}

impl Times {
    /// `1/60,1/15,0.25`, or the name of a file with one time a line.
    pub(super) fn parse(text: &str) -> anyhow::Result<Self> {
        let path = Path::new(text);
        if path.is_file() {
            return Self::read(path);
        }
        let times: Result<Vec<_>, String> = text.split(',').map(|t| parse_time(t).map(|t| (None, t))).collect();
        match times {
            Ok(times) => Ok(Self { place: "--times".to_owned(), times }),
            Err(message) if text.contains(',') => bail!("--times: {message}"),
            Err(message) => bail!("--times: {message}, and there is no file of that name"),
        }
    }

    fn read(path: &Path) -> anyhow::Result<Self> {
        let place = path.display().to_string();
        let size = std::fs::metadata(path).with_context(|| format!("cannot read {place}"))?.len();
        if size > LARGEST_FILE {
            bail!("{place}: {size} bytes are too many for a list of times");
        }
        let text = std::fs::read_to_string(path).with_context(|| format!("cannot read {place} as text"))?;
        let mut times = Vec::new();
        for (number, line) in text.lines().enumerate() {
            let line = line.split('#').next().unwrap_or_default().trim();
            if line.is_empty() {
                continue;
            }
            let (name, time) = match line.rsplit_once(char::is_whitespace) {
                Some((name, time)) => (Some(name.trim().to_owned()), time),
                None => (None, line),
            };
            let time_s = parse_time(time).map_err(|message| {
                anyhow::anyhow!("{place}, line {}: {message}; each line is TIME or NAME TIME", number + 1)
            })?;
            times.push((name, time_s));
        }
        Ok(Self { place, times })
    }

    /// The exposure of each photograph: by name where names were given, else in order.
    pub(super) fn of(&self, images: &[PathBuf]) -> anyhow::Result<Vec<Exposure>> {
        let named = self.times.iter().filter(|(name, _)| name.is_some()).count();
        if named != 0 && named != self.times.len() {
            bail!("{}: some lines have the name of a photograph and some have not; name all or none", self.place);
        }
        if named == 0 && self.times.len() != images.len() {
            bail!("{}: {} times for {} photographs; give one for each", self.place, self.times.len(), images.len());
        }
        let exposure = |(i, image): (usize, &PathBuf)| {
            let time_s = if named == 0 { Some(self.times[i].1) } else { self.named(image) };
            let Some(time_s) = time_s else {
                bail!("{}: no time for {}", self.place, image.display());
            };
            Ok(Exposure::of_time(&self.place, time_s)?)
        };
        images.iter().enumerate().map(exposure).collect()
    }

    fn named(&self, image: &Path) -> Option<f64> {
        let name = file_name(image);
        let is_it = |given: &Option<String>| given.as_deref().is_some_and(|g| g == name || Path::new(g) == image);
        self.times.iter().find(|(given, _)| is_it(given)).map(|(_, time_s)| *time_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn times(text: &str, images: &[&str]) -> anyhow::Result<Vec<f64>> {
        let images: Vec<PathBuf> = images.iter().map(PathBuf::from).collect();
        Ok(Times::parse(text)?.of(&images)?.iter().map(|e| e.time_s).collect())
    }

    #[test]
    fn lists_and_files_are_understood() {
        assert_eq!(times("1/4, 2", &["a", "b"]).unwrap(), [0.25, 2.0]);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("times.txt");
        let file = path.to_str().unwrap();
        std::fs::write(&path, "# seconds\n1/8\n\n4 # long\n").unwrap();
        assert_eq!(times(file, &["a", "b"]).unwrap(), [0.125, 4.0]);
        std::fs::write(&path, "b one.jpg 1/8\na.jpg\t4\nunused.jpg 9\n").unwrap();
        assert_eq!(times(file, &["x/a.jpg", "b one.jpg"]).unwrap(), [4.0, 0.125]);
        for (text, words) in [
            ("a.jpg 4\n", "no time for b.jpg"),
            ("a.jpg 4\n2\n", "name all or none"),
            ("a.jpg 4\nb.jpg none\n", "line 2"),
            ("", "0 times for 2"),
        ] {
            std::fs::write(&path, text).unwrap();
            let message = times(file, &["a.jpg", "b.jpg"]).unwrap_err().to_string();
            assert!(message.contains("times.txt") && message.contains(words), "{message}");
        }
    }
}
