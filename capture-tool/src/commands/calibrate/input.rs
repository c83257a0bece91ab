//! Where photographs of patterns come from: flags that several commands take.

use std::path::{Path, PathBuf};

use clap::Args;
use relume_core::Error;

use crate::commands::import::{EncodingChoice, one_size, pictures};
use crate::pack::develop::Developer;
use crate::pack::records::Records;
use crate::pack::shots::Shots;
use crate::rigs::RigFile;
use crate::session::{Description, Source};

/// Raw flags.
#[derive(Debug, Args)]
pub struct Input {
    /// A session that `relume capture` made, with calibration patterns.
    #[arg(required_unless_present_any = ["patterns", "photos"], conflicts_with_all = ["patterns", "photos", "encoding"])]
    session: Option<PathBuf>,
    /// The folder of the pictures that were shown.
    #[arg(long, value_name = "DIR", requires = "photos")]
    patterns: Option<PathBuf>,
    /// The folder of their photographs, in the same order by name.
    #[arg(long, value_name = "DIR")]
    photos: Option<PathBuf>,
    /// How the photographs' numbers become light [default: sRGB for 8 and 16 bits, linear for floats].
    #[arg(long, value_enum)]
    encoding: Option<EncodingChoice>,
}

impl Input {
    /// Opens what the flags name and goes on with it.
    pub fn with<T>(&self, then: impl FnOnce(&Shots<'_>) -> anyhow::Result<T>) -> anyhow::Result<T> {
        match (&self.session, &self.patterns, &self.photos) {
            (Some(session), _, _) => {
                let captured = Captured::open(session)?;
                then(&Shots::of_session(&captured.rig, &captured.records, &captured.developer)?)
            }
            (None, Some(patterns), Some(photos)) => {
                let (patterns, photographs) = (pictures(patterns)?, pictures(photos)?);
                one_size(patterns.iter())?;
                one_size(photographs.iter())?;
                then(&Shots::of_folders(&patterns, photographs, EncodingChoice::of(self.encoding))?)
            }
            _ => anyhow::bail!("give a session, or --patterns and --photos"),
        }
    }

    /// The folder of photographs, where it stands alone.
    pub fn photos(&self) -> Option<&Path> {
        self.photos.as_deref()
    }

    /// How its numbers become light.
    pub fn encoding(&self) -> relume_core::image::Encoding {
        EncodingChoice::of(self.encoding)
    }
}

/// A captured session, ready for developing.
pub struct Captured {
    /// Its rig.
    pub rig: RigFile,
    /// Its photographs.
    pub records: Records,
    /// Its camera.
    pub developer: Developer,
}

impl Captured {
    /// Opens a session.
    pub fn open(session: &Path) -> anyhow::Result<Self> {
        let Source::Capture(description) = Description::read(session)?.source else {
            let expected =
                "one that `relume capture` made; for photographs taken elsewhere give --patterns and --photos";
            return Err(Error::invalid(session.display().to_string(), "an imported session", expected).into());
        };
        let records = Records::read(session)?;
        let developer = Developer::new(&records, &description.rig.camera)?;
        Ok(Self { rig: description.rig, records, developer })
    }
}
