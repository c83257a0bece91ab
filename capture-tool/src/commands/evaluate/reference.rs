//! `relume evaluate reference`: relit pictures against photographs under the same picture on the screen (6.3).

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use clap::Args;
use maud::html;
use relume_core::Error;
use relume_core::evaluate::reference::BareScreen;
use relume_core::evaluate::{Comparison, compare};
use relume_core::field::{Access, Asset};
use relume_core::image::Image;
use relume_core::relight::ScreenRelighter;
use serde::Serialize;

use super::page::{Figure, document, put};
use super::pictures;
use crate::commands::calibrate::Captured;
use crate::new_folder::{self, NewFolder};
use crate::progress::{Progress, Unit};
use crate::rigs::Condition;
use crate::session::{Description, Photograph, Role, Source};

const EXAMPLES: &str = "\
Examples:
  relume evaluate reference glass-session --bare bare-session --field glass.rfield -o reference-report

Show pictures on the screen and photograph them with the object and, object removed, the bare screen:
  relume capture --session glass-session --resume --reference sunset.png
  relume capture rig.toml --session bare-session --bare
  relume capture --session bare-session --resume --reference sunset.png
The bare screen's photographs, through the field's correspondence, are the light that it is relit with,
so that the screen's colours need no calibration. Pictures are matched by their names.";

/// A pixel is the object's from this coverage on, and lit from this share of the brightest on.
const COVERED: f32 = 0.5;
const LIT: f32 = 0.01;

/// Raw flags.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// The session of the object, with photographs of pictures (`capture --reference`).
    session: PathBuf,
    /// The session of the bare screen (`capture --bare`), with the same pictures.
    #[arg(long, value_name = "SESSION")]
    bare: PathBuf,
    /// The field that was made of the session.
    #[arg(long, value_name = "A.rfield")]
    field: PathBuf,
    /// The folder to write to; it must be new or empty.
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
}

/// One picture.
#[derive(Debug, Serialize)]
struct Row {
    picture: String,
    /// Of all pixels.
    all: Comparison,
    /// Of those that the object covers and that are lit.
    object: Comparison,
}

/// A picture relit and photographed.
struct Pair {
    row: Row,
    photographed: Image,
    relit: Image,
}

impl Arguments {
    /// Compares and writes.
    pub fn run(self) -> anyhow::Result<String> {
        new_folder::check(&self.output)?;
        let folder = NewFolder::begin(&self.output)?;
        let pairs = self.pairs()?;
        let table = table(&pairs);
        write(&pairs, &table, folder.path())?;
        folder.commit()?;
        Ok(format!("{table}\nOpen {}\n", self.output.join("index.html").display()))
    }

    fn pairs(&self) -> anyhow::Result<Vec<Pair>> {
        let field = ScreenRelighter::new(Asset::open(&self.field, Access::Mapped)?)?;
        let Some(correspondence) = field.correspondence() else {
            let expected = "one whose session had Gray codes or stripes";
            let found = "a field that does not know where its pixels look";
            return Err(Error::invalid(self.field.display().to_string(), found, expected).into());
        };
        if let Source::Capture(capture) = Description::read(&self.bare)?.source {
            capture.check_bare(&self.bare)?;
        }
        let (with, without) = (Shown::open(&self.session)?, Shown::open(&self.bare)?);
        let white = without.find(Role::AllLit, &Condition::White { stop: 0 })?;
        let bare = BareScreen::new(without.lit(white)?, correspondence, field.plane())?;
        let pictures: Vec<&Photograph> = with.captured.records.of(Role::Picture).collect();
        if pictures.is_empty() {
            let expected = "some: `relume capture --resume --reference IMG`";
            return Err(
                Error::invalid(self.session.display().to_string(), "no photographs of pictures", expected).into()
            );
        }
        let mut progress = Progress::new("comparing", Unit::Steps);
        let mut pairs = Vec::new();
        for (n, photograph) in pictures.iter().enumerate() {
            let shown = without.lit(without.find(Role::Picture, &photograph.condition)?)?;
            let photographed = bare.in_units(&with.lit(photograph)?)?;
            let relit = bare.relit(&field, &shown)?;
            let covered = covered(field.asset(), &photographed);
            let row = Row {
                picture: photograph.condition.to_string(),
                all: compare(&relit, &photographed, None)?,
                object: compare(&relit, &photographed, Some(&covered))?,
            };
            pairs.push(Pair { row, photographed, relit });
            progress.step(n as u64 + 1, pictures.len() as u64)?;
        }
        Ok(pairs)
    }
}

/// The photographs of a session.
struct Shown<'a> {
    session: &'a Path,
    captured: Captured,
    black: Image,
}

impl<'a> Shown<'a> {
    fn open(session: &'a Path) -> anyhow::Result<Self> {
        let captured = Captured::open(session)?;
        let missing = || {
            let expected = "one, to be subtracted from the others";
            Error::invalid(session.display().to_string(), "no photograph of the black screen", expected)
        };
        let black = captured.records.of(Role::Black).last().ok_or_else(missing)?;
        let black = captured.developer.picture(&captured.records, black)?;
        Ok(Self { session, captured, black })
    }

    fn find(&self, role: Role, condition: &Condition) -> Result<&Photograph, Error> {
        self.captured.records.find(role, condition).ok_or_else(|| {
            let found = format!("no photograph of {condition}");
            let expected = "one: the same pictures with the object and without it";
            Error::invalid(self.session.display().to_string(), found, expected)
        })
    }

    /// A photograph with the black one subtracted.
    fn lit(&self, photograph: &Photograph) -> Result<Image, Error> {
        let mut picture = self.captured.developer.picture(&self.captured.records, photograph)?;
        picture.data_mut().iter_mut().zip(self.black.data()).for_each(|(v, black)| *v -= black);
        Ok(picture)
    }
}

/// White where the object covers and is lit.
fn covered(asset: &Asset, photographed: &Image) -> Image {
    let most = photographed.data().iter().fold(0.0f32, |most, v| most.max(*v));
    let width = photographed.width();
    Image::from_fn(width, photographed.height(), |x, y| {
        let covers = asset.alpha().is_none_or(|alpha| alpha[y * width + x] > COVERED);
        let lit = photographed.pixel(x, y).iter().any(|v| *v > LIT * most);
        [if covers && lit { 1.0 } else { 0.0 }; 3]
    })
}

fn table(pairs: &[Pair]) -> String {
    let mut text = format!("{:<32}{:>12}{:>12}{:>14}\n", "relative L2", "object", "all", "energy");
    for Pair { row, .. } in pairs {
        let name: String = row.picture.chars().take(30).collect();
        let (object, all) = (100.0 * row.object.relative_l2, 100.0 * row.all.relative_l2);
        // Writing to a String does not fail.
        let _ = writeln!(text, "{name:<32}{object:>10.2} %{all:>10.2} %{:>14.4}", row.object.ratio_of_means);
    }
    text
}

fn write(pairs: &[Pair], table: &str, folder: &Path) -> anyhow::Result<()> {
    let rows: Vec<&Row> = pairs.iter().map(|pair| &pair.row).collect();
    let json = serde_json::to_string_pretty(&rows)? + "\n";
    put(folder, [("errors.json", json.as_bytes()), ("errors.txt", table.as_bytes())])?;
    let mut figures = Vec::new();
    for (n, pair) in pairs.iter().enumerate() {
        let gain = pictures::gain(&pair.photographed);
        let mut difference = pair.relit.clone();
        let values = difference.data_mut().iter_mut().zip(pair.photographed.data());
        values.for_each(|(v, photographed)| *v = 10.0 * (*v - photographed).abs());
        let figure = |what: &str, picture: &Image| Figure::new(format!("{}-{what}.png", n + 1), picture, gain);
        figures.push([
            figure("photographed", &pair.photographed)?,
            figure("relit", &pair.relit)?,
            figure("difference", &difference)?,
        ]);
    }
    put(folder, figures.iter().flatten().map(Figure::file))?;
    let body = html! {
        p {
            "Each picture was on the screen while object and bare screen were photographed. Relit: the field under the light of "
            "the bare screen's photograph, over that photograph (Peers 2006, 6.3). Error: ‖relit − photographed‖ / ‖photographed‖ "
            "over the pixels that the object covers and that are lit."
        }
        @for (pair, figures) in pairs.iter().zip(&figures) {
            h2 { (pair.row.picture) }
            p { (format!("{:.2} % on the object, {:.2} % on all", 100.0 * pair.row.object.relative_l2, 100.0 * pair.row.all.relative_l2)) }
            div.row {
                @for (figure, name) in figures.iter().zip(["photographed", "relit", "difference, 10 times"]) {
                    (figure.show("wide", html! { (name) }))
                }
            }
        }
        p.note { "Numbers: errors.json; pictures in full size lie beside this page." }
    };
    put(folder, [("index.html", document("Relit and photographed", &body).as_bytes())])?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::testing;

    #[test]
    fn wrong_usage_is_refused_by_the_parser() {
        for line in ["reference s -o d", "reference s --bare b -o d", "reference s --field f --bare b"] {
            assert!(testing::parse::<Arguments>(line).is_err(), "{line}");
        }
        assert!(testing::parse::<Arguments>("reference s --bare b --field f -o d").is_ok());
    }
}
