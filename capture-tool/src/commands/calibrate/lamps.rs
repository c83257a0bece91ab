//! `relume calibrate lamps`: photographs of a ball under one lamp each -> a `.lp` file, and a table of irradiances and
//! places.

use std::collections::BTreeSet;
use std::f64::consts::PI;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf, absolute};

use anyhow::Context;
use clap::Args;
use relume_core::calibrate::lamp_table::{self, Row};
use relume_core::calibrate::lamps::{Lamp, Rules, Stand, judge, pointed_at};
use relume_core::calibrate::near::{self, Plane};
use relume_core::calibrate::overrides::{self, Override, Overrides};
use relume_core::calibrate::reflect::{Ball, Lens};
use relume_core::calibrate::survey::{Outlines, Survey, Surveyed};
use relume_core::domain::lp::{self, Lp};
use relume_core::files;
use relume_core::illumination::probe::Circle;
use relume_core::image::Window;
use relume_core::math::Vec3;

use crate::commands::import::EncodingChoice;
use crate::commands::values;
use crate::progress::{Progress, Unit};

const EXAMPLES: &str = "\
Examples:
  relume calibrate lamps photographs/a.jpg photographs/b.jpg --ball 1034.5,220,96.2 -o photographs/lights.lp
  relume calibrate lamps a.jpg b.jpg --find-balls=2 --override by-hand.txt -o lights.lp
  relume calibrate lamps a.tif b.tif --ball 900,200,80 --patch 40,900,60,60 --patch-reflectance 0.9 -o lights.lp
  relume calibrate lamps a.tif b.tif --ball 90,80,60 --ball 900,85,61 --ball-radius-m 0.02 -o lights.lp

Photographs that tell nothing, or nothing certain, are named with the reason and left out. A file given
with --override settles them, one photograph a line:
  photo12.jpg 1034.5 220        the highlight stands at this pixel
  photo13.jpg dir 0.1 0.7 0.7   the light comes from this direction
  photo14.jpg skip              leave this photograph out

With --patch, or where the lamps' places are known, a table is written beside the .lp file
(lights.lamps.tsv), for `relume import lp --lamps`. Balls are taken to be perfectly round and to reflect
at their surface; black ones are best.";

/// Raw flags.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// The photographs, one lamp each.
    #[arg(required = true)]
    photographs: Vec<PathBuf>,
    /// The .lp file to write. Names in it are relative to its folder.
    #[arg(short, long, value_name = "OUT.lp")]
    output: PathBuf,
    #[command(flatten)]
    balls: BallArguments,
    /// Horizontal field of view of the photographs [default: a far camera].
    #[arg(long, value_name = "DEG", value_parser = angle)]
    view: Option<f64>,
    /// How the photographs' numbers become light [default: sRGB for 8 and 16 bits, linear for floats].
    #[arg(long, value_enum)]
    encoding: Option<EncodingChoice>,
    /// The photograph with every lamp off, subtracted from the others.
    #[arg(long, value_name = "IMG")]
    black: Option<PathBuf>,
    /// What you know better: a file with a line for each doubtful photograph.
    #[arg(long = "override", value_name = "FILE")]
    overrides: Option<PathBuf>,
    /// Balls agree when their directions differ by no more.
    #[arg(long, value_name = "DEG", default_value_t = 3.0, value_parser = angle)]
    agree: f64,
    /// A white or grey matte patch: its left, top, width and height in pixels. It tells how bright the lamps are.
    #[arg(long, value_name = "X,Y,W,H", value_parser = rectangle)]
    patch: Option<Window>,
    /// Normal of the patch.
    #[arg(long, value_name = "X,Y,Z", default_value = "0,0,1", allow_negative_numbers = true, requires = "patch",
          value_parser = direction)]
    patch_normal: Direction,
    /// Reflectance of the patch.
    #[arg(long, value_name = "SHARE", default_value_t = 1.0, requires = "patch", value_parser = values::positive)]
    patch_reflectance: f32,
    /// Radius of the balls in metres: lamps get places, from two or more balls or --distance-m.
    #[arg(long, value_name = "M", value_parser = values::positive)]
    ball_radius_m: Option<f32>,
    /// Distance of every lamp from the object in metres.
    #[arg(long, value_name = "M", requires = "ball_radius_m", value_parser = values::positive)]
    distance_m: Option<f32>,
    /// The pixel that shows the object's middle, where distances start [default: the middle of the picture].
    #[arg(long, value_name = "X,Y", allow_negative_numbers = true, value_parser = values::list::<2>)]
    origin: Option<[f64; 2]>,
}

/// Where the balls are: given or found.
#[derive(Debug, Args)]
#[group(required = true, multiple = false)]
struct BallArguments {
    /// Outline of a ball in pixels from the top left corner; may be given several times.
    #[arg(long = "ball", value_name = "X,Y,R", value_parser = values::circle)]
    balls: Vec<Circle>,
    /// Look for the outlines of this many balls [without a number: 1].
    #[arg(long, value_name = "COUNT", num_args = 0..=1, require_equals = true, default_missing_value = "1",
          value_parser = clap::value_parser!(u8).range(1..=16))]
    find_balls: Option<u8>,
}

/// A unit vector.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Direction(Vec3);

fn direction(text: &str) -> Result<Direction, String> {
    let vector = Vec3::from(values::list::<3>(text)?);
    vector.try_normalize(1e-9).map(Direction).ok_or_else(|| "a vector without length".to_owned())
}

fn angle(text: &str) -> Result<f64, String> {
    let value = values::finite(text)?;
    if value > 0.0 && value < 180.0 { Ok(value) } else { Err("not more than 0 and less than 180 degrees".to_owned()) }
}

fn rectangle(text: &str) -> Result<Window, String> {
    let numbers = values::list::<4>(text)?;
    if numbers.iter().any(|v| *v < 0.0 || v.fract() != 0.0 || *v > 1e6) || numbers[2] < 1.0 || numbers[3] < 1.0 {
        return Err("not four whole numbers X,Y,W,H of a rectangle of pixels".to_owned());
    }
    let [x, y, w, h] = numbers.map(|v| v as usize);
    Ok(Window { x0: x, y0: y, x1: x + w, y1: y + h })
}

/// Checked flags.
#[derive(Debug)]
struct Plan {
    survey: Survey,
    names: Vec<String>,
    output: PathBuf,
    overrides: Overrides,
    agree_rad: f64,
    normal: Vec3,
    reflectance: f64,
    ball_radius_m: Option<f64>,
    distance_m: Option<f64>,
    origin: Option<[f64; 2]>,
}

impl Arguments {
    /// Calibrates and writes.
    pub fn run(self) -> anyhow::Result<String> {
        self.plan()?.carry_out()
    }

    /// Refuses what can be known to fail before the work.
    fn plan(self) -> anyhow::Result<Plan> {
        let extension = self.output.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        anyhow::ensure!(extension == "lp", "{}: the file to write must end in .lp", self.output.display());
        files::check_folder(&self.output)?;
        let names: Vec<String> = self.photographs.iter().map(|path| file_name(path)).collect();
        let mut met = BTreeSet::new();
        if let Some(twice) = names.iter().find(|name| !met.insert(*name)) {
            anyhow::bail!("two photographs are called {twice}; each needs a name of its own");
        }
        let overrides = match &self.overrides {
            Some(path) => overrides::read(path, &names)?,
            None => Overrides::new(),
        };
        let survey = Survey {
            photographs: self.photographs,
            encoding: EncodingChoice::of(self.encoding),
            black: self.black,
            outlines: match self.balls.find_balls {
                Some(count) => Outlines::Find(usize::from(count)),
                None => Outlines::Given(self.balls.balls),
            },
            view_rad: self.view.map(f64::to_radians),
            patch: self.patch,
        };
        Ok(Plan {
            survey,
            names,
            output: self.output,
            overrides,
            agree_rad: self.agree.to_radians(),
            normal: self.patch_normal.0,
            reflectance: f64::from(self.patch_reflectance),
            ball_radius_m: self.ball_radius_m.map(f64::from),
            distance_m: self.distance_m.map(f64::from),
            origin: self.origin,
        })
    }
}

fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

impl Plan {
    fn carry_out(&self) -> anyhow::Result<String> {
        let mut progress = Progress::new("looking at balls", Unit::Steps);
        let seen = self.survey.run(&mut |done, all| progress.step(done, all));
        drop(progress);
        let seen = seen.map_err(|error| self.advise(error))?;
        let rules = self.rules(&seen);
        let mut lamps = judge(&seen.spots, &rules);
        self.overrule(&mut lamps, &seen, &rules)?;
        let kept: Vec<usize> = (0..lamps.len()).filter(|&k| lamps[k].direction.is_some()).collect();
        if kept.is_empty() {
            let first = self.reasons(0, &lamps[0]);
            anyhow::bail!(
                "no photograph tells where its lamp stands ({first}); check --ball, or name the highlights with --override"
            );
        }
        let mut report = String::new();
        for ball in seen.balls.iter().filter(|_| matches!(self.survey.outlines, Outlines::Find(_))) {
            let Circle { x, y, radius } = ball.circle();
            let _ = writeln!(report, "outline found: --ball {x:.1},{y:.1},{radius:.1}");
        }
        for (k, lamp) in
            lamps.iter().enumerate().filter(|(_, lamp)| lamp.direction.is_none() || !lamp.doubts.is_empty())
        {
            let verdict = if lamp.direction.is_some() { "kept, but" } else { "left out:" };
            let _ = writeln!(report, "{}: {verdict} {}", self.names[k], self.reasons(k, lamp));
        }
        let table = self.table(&lamps, &kept, &seen, &mut report);
        self.write_lp(&lamps, &kept)?;
        let _ = writeln!(report, "{}: {} lamps from {} photographs", self.output.display(), kept.len(), lamps.len());
        if let Some(rows) = table {
            let path = self.output.with_extension("lamps.tsv");
            write_text(&path, &lamp_table::text(&rows))?;
            let _ = writeln!(
                report,
                "{}: irradiances{}",
                path.display(),
                if rows[0].position_m.is_some() { " and places" } else { "" }
            );
        }
        Ok(report)
    }

    /// Where balls were looked for in vain, which option gives them.
    fn advise(&self, error: relume_core::Error) -> anyhow::Error {
        let looked = matches!((&self.survey.outlines, &error), (Outlines::Find(_), relume_core::Error::Invalid { found, .. }) if found.contains("outline"));
        if looked { anyhow::Error::new(error).context("balls were not found; give --ball X,Y,R") } else { error.into() }
    }

    fn rules(&self, seen: &Surveyed) -> Rules {
        let disc_px = seen.balls.iter().map(|b| PI * b.circle().radius.powi(2)).collect();
        let stands = self
            .ball_radius_m
            .map(|radius_m| stands(&seen.balls, radius_m, self.plane(seen).origin_px, self.survey.view_rad, seen.size));
        Rules { agree_rad: self.agree_rad, disc_px, stands, distance_m: self.distance_m }
    }

    /// The object's plane, with the balls as its scale; only of use where their radius is known.
    fn plane(&self, seen: &Surveyed) -> Plane {
        let mean_px = seen.balls.iter().map(|ball| ball.circle().radius).sum::<f64>() / seen.balls.len() as f64;
        let middle = [0.5 * seen.size.0 as f64, 0.5 * seen.size.1 as f64];
        Plane {
            metres_per_pixel: self.ball_radius_m.unwrap_or(0.0) / mean_px,
            origin_px: self.origin.unwrap_or(middle),
        }
    }

    /// What the person said goes before what was found.
    fn overrule(&self, lamps: &mut [Lamp], seen: &Surveyed, rules: &Rules) -> anyhow::Result<()> {
        for (name, said) in &self.overrides {
            let Some(k) = self.names.iter().position(|n| n == name) else { continue };
            lamps[k] = match said {
                Override::Skip => Lamp::default(),
                Override::Direction(direction) => Lamp { direction: Some(*direction), ..Lamp::default() },
                Override::Pixel { x, y } => {
                    let hit = seen.balls.iter().enumerate().find_map(|(n, ball)| Some((n, ball.reflect(*x, *y)?)));
                    let (ball, r) =
                        hit.with_context(|| format!("the override of {name}: pixel ({x}, {y}) lies on no ball"))?;
                    pointed_at(ball, r.direction, r.normal, rules)
                }
            };
        }
        Ok(())
    }

    fn reasons(&self, k: usize, lamp: &Lamp) -> String {
        if self.overrides.get(&self.names[k]) == Some(&Override::Skip) {
            return "as the override says".to_owned();
        }
        let reasons: Vec<String> = lamp.doubts.iter().map(ToString::to_string).collect();
        reasons.join("; ")
    }

    /// Irradiances from the patch (pi without one), and places; `None` when nothing is known of either.
    fn table(&self, lamps: &[Lamp], kept: &[usize], seen: &Surveyed, report: &mut String) -> Option<Vec<Row>> {
        let placed = kept.iter().any(|&k| lamps[k].position_m.is_some());
        if seen.patch.is_none() && !placed {
            return None;
        }
        let patch_m =
            self.survey.patch.map(|p| self.plane(seen).point(0.5 * (p.x0 + p.x1) as f64, 0.5 * (p.y0 + p.y1) as f64));
        let irradiance = |k: usize| {
            let radiance = seen.patch.as_ref()?[k];
            match lamps[k].position_m {
                Some(lamp) => near::irradiance_at_origin(radiance, self.reflectance, &self.normal, &patch_m?, &lamp),
                None => near::irradiance(radiance, self.reflectance, &self.normal, &lamps[k].direction?),
            }
        };
        let measured: Vec<Option<f64>> = kept.iter().map(|&k| irradiance(k)).collect();
        let mut known: Vec<f64> = measured.iter().flatten().copied().collect();
        known.sort_by(f64::total_cmp);
        let usual = known.get(known.len() / 2).copied().unwrap_or(PI);
        let row = |(&k, e): (&usize, &Option<f64>)| {
            if e.is_none() && seen.patch.is_some() {
                let _ = writeln!(
                    report,
                    "{}: kept, but its lamp does not light the patch; its irradiance is taken to be the median",
                    self.names[k]
                );
            }
            Row { photograph: self.names[k].clone(), irradiance: e.unwrap_or(usual), position_m: lamps[k].position_m }
        };
        Some(kept.iter().zip(&measured).map(row).collect())
    }

    fn write_lp(&self, lamps: &[Lamp], kept: &[usize]) -> anyhow::Result<()> {
        let folder = absolute(files::folder_of(&self.output))?;
        let name = |k: &usize| -> anyhow::Result<PathBuf> {
            let whole = absolute(&self.survey.photographs[*k])?;
            Ok(whole.strip_prefix(&folder).map(Path::to_owned).unwrap_or(whole))
        };
        let photographs = kept.iter().map(name).collect::<anyhow::Result<_>>()?;
        let directions = kept.iter().filter_map(|&k| lamps[k].direction).collect();
        write_text(&self.output, &lp::text(&Lp { photographs, directions }))
    }
}

fn write_text(path: &Path, text: &str) -> anyhow::Result<()> {
    let write = |error| relume_core::Error::io("write", path, error);
    Ok(files::write_whole(path, |file| file.write_all(text.as_bytes()).map_err(write))?)
}

/// Where balls of one radius stand. A far camera cannot tell depth: their middles are taken to lie in the plane z = 0.
/// Of a pinhole the origin is taken at the balls' mean depth.
fn stands(
    balls: &[Ball],
    radius_m: f64,
    [ox, oy]: [f64; 2],
    view_rad: Option<f64>,
    size: (usize, usize),
) -> Vec<Stand> {
    let middles: Option<Vec<Vec3>> = balls.iter().map(|ball| Some(ball.from_pinhole()? * radius_m)).collect();
    let lens = view_rad.and_then(|view| Lens::pinhole(size.0, size.1, view).ok());
    let middles = match (middles, lens) {
        (Some(middles), Some(lens)) => {
            let depth = middles.iter().map(|m| m.z).sum::<f64>() / middles.len() as f64;
            let ray = lens.flight(ox, oy);
            let origin = ray * (depth / ray.z);
            middles.iter().map(|m| m - origin).collect()
        }
        _ => {
            let place = |ball: &Ball| {
                let Circle { x, y, radius } = ball.circle();
                Vec3::new(x - ox, oy - y, 0.0) * (radius_m / radius)
            };
            balls.iter().map(place).collect::<Vec<Vec3>>()
        }
    };
    middles.into_iter().map(|middle_m| Stand { middle_m, radius_m }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::testing::parse;

    fn plan(line: &str) -> anyhow::Result<Plan> {
        parse::<Arguments>(line)?.plan()
    }

    #[test]
    fn flags_reach_the_plan() {
        let plan = plan(
            "lamps a.jpg b.jpg --ball 10,20,5 --ball 40,20,5.5 --patch 1,2,3,4 --patch-normal 0,3,4 --view 30 -o l.lp",
        )
        .unwrap();
        assert_eq!(plan.survey.photographs.len(), 2);
        let Outlines::Given(balls) = &plan.survey.outlines else { panic!("given") };
        assert_eq!(balls[1], Circle { x: 40.0, y: 20.0, radius: 5.5 });
        assert_eq!(plan.survey.patch, Some(Window { x0: 1, y0: 2, x1: 4, y1: 6 }));
        assert!((plan.normal - Vec3::new(0.0, 0.6, 0.8)).norm() < 1e-12);
    }

    #[test]
    fn balls_are_given_or_found() {
        assert!(matches!(plan("lamps --find-balls a.jpg -o l.lp").unwrap().survey.outlines, Outlines::Find(1)));
        assert!(matches!(plan("lamps a.jpg --find-balls=3 -o l.lp").unwrap().survey.outlines, Outlines::Find(3)));
        for line in [
            "lamps a.jpg -o l.lp",
            "lamps a.jpg --find-balls --ball 1,2,3 -o l.lp",
            "lamps a.jpg --ball 1,2 -o l.lp",
            "lamps a.jpg --ball 1,2,-3 -o l.lp",
            "lamps --find-balls -o l.lp",
            "lamps a.jpg --ball 1,2,3 -o l.txt",
            "lamps a.jpg x/a.jpg --ball 1,2,3 -o l.lp",
            "lamps a.jpg --ball 1,2,3 --view wide -o l.lp",
            "lamps a.jpg --ball 1,2,3 --patch 1,2,0,4 -o l.lp",
            "lamps a.jpg --ball 1,2,3 --distance-m 2 -o l.lp",
        ] {
            assert!(plan(line).is_err(), "{line}");
        }
    }
}
