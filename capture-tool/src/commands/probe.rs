//! `relume probe`: a picture of the surroundings in any projection -> the same in any other.

use std::path::{Path, PathBuf};

use anyhow::Context;
use clap::{Args, ValueEnum};
use relume_core::calibrate::ball::find_ball;
use relume_core::illumination::probe::{Circle, Target, View, resample};
use relume_core::image::{self, EncodeOptions, Encoding, Image};
use relume_core::math::projection::Projection;

use super::values;
use crate::progress::{self, Progress, Unit};

const EXAMPLES: &str = "\
Examples:
  relume probe ball.exr -o surroundings.exr
  relume probe ball.exr -o surroundings.exr --circle 512.5,384,301.2 --reflectance 0.9 --distance 40
  relume probe ball.exr --second ball-from-the-right.exr --angle 90 -o surroundings.exr
  relume probe up.exr --from equisolid --fov 185 --circle inscribed --second down.exr --angle 180 -o surroundings.exr
  relume probe park.hdr --from latlong --to cube --size 512 -o park-cube.exr

A mirror ball is photographed by the camera on +z: the middle of the ball shows the camera (+z), its
right side +x, its rim what lies behind the ball (-z). All other pictures are what an observer at the
object sees, with +z in the middle and +x on the left; with --from-centre or --to-centre behind, -z is in
the middle and +x on the right (Debevec's angular maps). A cube map is OpenEXR's: six faces in a vertical
strip, from the top +x, -x, +y, -y, +z, -z.

Without --distance the camera is taken to be far away: at D radii of the ball, directions near the rim
are then wrong by up to asin(1/D), 3 degrees at 20 radii.";

/// Columns of the new picture (of a cube: of a face) where none are given.
const SIZE: usize = 1024;
const CUBE_SIZE: usize = 256;

/// Raw flags.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// The picture: linear (EXR, HDR) for light that can be used; PNG, TIFF and JPEG are taken as sRGB.
    picture: PathBuf,
    /// The picture to write.
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
    /// Projection of the picture.
    #[arg(long, value_enum, default_value_t = Kind::Ball)]
    from: Kind,
    /// Projection of the new picture.
    #[arg(long, value_enum, default_value_t = Kind::Latlong)]
    to: Kind,
    /// Columns of the new picture; of a cube, of one face [default: 1024, cube 256].
    #[arg(long, value_name = "W", value_parser = clap::value_parser!(u16).range(2..=16384))]
    size: Option<u16>,
    /// Outline of the ball or of a fisheye's disc: centre and radius in pixels from the top left corner, `found` (look
    /// for the outline), or `inscribed` (the largest circle) [default: found for a ball, else inscribed].
    #[arg(long, value_name = "X,Y,R|found|inscribed", allow_negative_numbers = true, value_parser = outline)]
    circle: Option<Outline>,
    /// A second picture of the same kind, taken from another side: merged, so that camera and blind rim vanish.
    #[arg(long, value_name = "PICTURE")]
    second: Option<PathBuf>,
    /// Outline in the second picture, as --circle.
    #[arg(long, value_name = "X,Y,R|found|inscribed", requires = "second", allow_negative_numbers = true,
          value_parser = outline)]
    second_circle: Option<Outline>,
    /// Where the second camera stood: its heading from the first, about +y, from +z towards +x.
    #[arg(long, value_name = "DEG", requires = "second", default_value_t = 90.0, allow_negative_numbers = true,
          value_parser = values::finite)]
    angle: f64,
    /// Half-angle about the middle of a ball that the camera hides; of use with --second.
    #[arg(long, value_name = "DEG", default_value_t = 10.0, value_parser = camera_angle)]
    camera_angle: f64,
    /// From the camera to the middle of the ball, in radii of the ball [default: far away].
    #[arg(long, value_name = "RADII", value_parser = distance)]
    distance: Option<f64>,
    /// Reflectance of the ball: the picture is divided by it.
    #[arg(long, value_name = "SHARE", default_value_t = 1.0, value_parser = values::positive)]
    reflectance: f32,
    /// Field of view across a fisheye's circle.
    #[arg(long, value_name = "DEG", default_value_t = 180.0, value_parser = field_of_view)]
    fov: f64,
    /// Field of view across the circle of a fisheye to make [default: as --fov].
    #[arg(long, value_name = "DEG", value_parser = field_of_view)]
    to_fov: Option<f64>,
    /// What stands in the middle of a picture other than a ball: front (+z, towards the camera) or behind (-z).
    #[arg(long, value_enum, default_value_t = Centre::Front)]
    from_centre: Centre,
    /// The same of the new picture.
    #[arg(long, value_enum, default_value_t = Centre::Front)]
    to_centre: Centre,
    /// Turns the surroundings about +y, right-handed: light from +z moves to +x.
    #[arg(long, value_name = "DEG", default_value_t = 0.0, allow_negative_numbers = true, value_parser = values::finite)]
    turn: f64,
}

/// Projections as the command line names them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Kind {
    /// A photograph of a mirror ball.
    Ball,
    /// The whole sphere, angle from the middle in proportion to the radius.
    Angular,
    /// A fisheye whose angle is in proportion to the radius.
    Equidistant,
    /// A fisheye of equal areas.
    Equisolid,
    /// OpenEXR's vertical strip of six faces.
    Cube,
    /// Longitude and latitude, twice as wide as high.
    Latlong,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Centre {
    Front,
    Behind,
}

/// Where the disc of a round picture is.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Outline {
    Found,
    Inscribed,
    Given(Circle),
}

fn outline(text: &str) -> Result<Outline, String> {
    match text {
        "found" => Ok(Outline::Found),
        "inscribed" => Ok(Outline::Inscribed),
        _ => values::circle(text).map(Outline::Given).map_err(|why| format!("{why}, or `found`, or `inscribed`")),
    }
}

fn within(text: &str, low: f64, high: f64) -> Result<f64, String> {
    let value = values::finite(text)?;
    if value > low && value <= high { Ok(value) } else { Err(format!("not above {low} and up to {high}")) }
}

fn field_of_view(text: &str) -> Result<f64, String> {
    within(text, 0.0, 360.0)
}

fn camera_angle(text: &str) -> Result<f64, String> {
    let value = values::finite(text)?;
    if (0.0..=60.0).contains(&value) { Ok(value) } else { Err("not between 0 and 60".to_owned()) }
}

fn distance(text: &str) -> Result<f64, String> {
    within(text, 1.0, 1e9)
}

/// A picture to read, and how.
#[derive(Debug, Clone, PartialEq)]
struct Source {
    path: PathBuf,
    outline: Outline,
    heading_deg: f64,
}

/// Checked flags.
#[derive(Debug, Clone, PartialEq)]
struct Plan {
    sources: Vec<Source>,
    from: Projection,
    target: Target,
    output: PathBuf,
    reflectance: f32,
    camera_deg: f64,
}

impl Arguments {
    /// Resamples and writes.
    pub fn run(self) -> anyhow::Result<String> {
        self.plan()?.carry_out()
    }

    /// Refuses what can be known to fail before the work.
    fn plan(self) -> anyhow::Result<Plan> {
        image::check_output(&self.output)?;
        let ball = self.from == Kind::Ball;
        let round = !matches!(self.from, Kind::Cube | Kind::Latlong);
        anyhow::ensure!(ball || self.distance.is_none(), "--distance belongs to --from ball");
        anyhow::ensure!(ball || self.reflectance == 1.0, "--reflectance belongs to --from ball");
        anyhow::ensure!(
            round || self.circle.is_none(),
            "--circle belongs to round pictures, not to cube and lat-long maps"
        );
        let usual = if ball { Outline::Found } else { Outline::Inscribed };
        let turned =
            |centre: Centre, kind: Kind| if centre == Centre::Behind && kind != Kind::Ball { 180.0 } else { 0.0 };
        let heading_deg = self.turn + turned(self.from_centre, self.from);
        let outline = if round { self.circle.unwrap_or(usual) } else { Outline::Inscribed };
        let mut sources = vec![Source { path: self.picture, outline, heading_deg }];
        if let Some(path) = self.second {
            let outline = self.second_circle.unwrap_or(if outline == Outline::Inscribed { outline } else { usual });
            sources.push(Source { path, outline, heading_deg: heading_deg + self.angle });
        }
        let target = Target {
            projection: projection(self.to, self.to_fov.unwrap_or(self.fov), None),
            width: self.size.map_or(if self.to == Kind::Cube { CUBE_SIZE } else { SIZE }, usize::from),
            heading_rad: turned(self.to_centre, self.to).to_radians(),
        };
        Ok(Plan {
            sources,
            from: projection(self.from, self.fov, self.distance),
            target,
            output: self.output,
            reflectance: self.reflectance,
            camera_deg: self.camera_angle,
        })
    }
}

fn projection(kind: Kind, fov_deg: f64, distance: Option<f64>) -> Projection {
    match kind {
        Kind::Ball => Projection::Ball { distance },
        Kind::Angular => Projection::ANGULAR,
        Kind::Equidistant => Projection::Equidistant { view_rad: fov_deg.to_radians() },
        Kind::Equisolid => Projection::Equisolid { view_rad: fov_deg.to_radians() },
        Kind::Cube => Projection::Cube,
        Kind::Latlong => Projection::LatLong,
    }
}

impl Plan {
    fn carry_out(&self) -> anyhow::Result<String> {
        let mut report = String::new();
        let mut views = Vec::new();
        for source in &self.sources {
            progress::check()?;
            views.push(self.view(source, &mut report)?);
        }
        let mut progress = Progress::new("resampling", Unit::Steps);
        let made = resample(&views, &self.target, &mut |done, all| progress.step(done, all))?;
        drop(progress);
        image::write(&self.output, &made.image, EncodeOptions::default())?;
        let (w, h) = made.image.size();
        report += &format!("{}: {w} x {h} pixels", self.output.display());
        if made.seen < 0.9995 {
            report += &format!(", {:.1} % of it seen by the picture, the rest black", 100.0 * made.seen);
        }
        Ok(report + "\n")
    }

    fn view(&self, source: &Source, report: &mut String) -> anyhow::Result<View> {
        let mut picture = image::read(&source.path, Encoding::Auto)?.into_rgb();
        picture.data_mut().iter_mut().for_each(|v| *v /= self.reflectance);
        let circle = self.circle(&picture, source, report)?;
        let view = View::new(picture, self.from, circle, source.heading_deg.to_radians())
            .with_context(|| format!("cannot use {}", source.path.display()))?;
        Ok(view.hiding_camera(self.camera_deg.to_radians()))
    }

    fn circle(&self, picture: &Image, source: &Source, report: &mut String) -> anyhow::Result<Option<Circle>> {
        let name = |path: &Path| path.display().to_string();
        Ok(match source.outline {
            Outline::Given(circle) => Some(circle),
            Outline::Found => {
                let found = find_ball(picture, &name(&source.path)).context("no ball found; give --circle X,Y,R")?;
                let Circle { x, y, radius } = found;
                *report += &format!("{}: outline found, --circle {x:.1},{y:.1},{radius:.1}\n", name(&source.path));
                Some(found)
            }
            Outline::Inscribed => None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::testing::parse;

    fn plan(line: &str) -> anyhow::Result<Plan> {
        parse::<Arguments>(line)?.plan()
    }

    #[test]
    fn defaults() {
        let plan = plan("probe ball.exr -o map.exr").unwrap();
        assert_eq!(plan.from, Projection::Ball { distance: None });
        assert_eq!((plan.target.projection, plan.target.width), (Projection::LatLong, 1024));
        assert_eq!((plan.sources[0].outline, plan.sources[0].heading_deg), (Outline::Found, 0.0));
    }

    #[test]
    fn flags_reach_the_plan() {
        let plan = plan(
            "probe a.exr -o b.exr --from equisolid --fov 185 --circle 10,20,5.5 --second c.exr --angle 180 --turn -30 \
             --from-centre behind --to cube --size 64",
        )
        .unwrap();
        assert_eq!(plan.from, Projection::Equisolid { view_rad: 185f64.to_radians() });
        assert_eq!((plan.target.projection, plan.target.width), (Projection::Cube, 64));
        assert_eq!(plan.sources[0].outline, Outline::Given(Circle { x: 10.0, y: 20.0, radius: 5.5 }));
        assert_eq!((plan.sources[0].heading_deg, plan.sources[1].heading_deg), (150.0, 330.0));
    }

    #[test]
    fn what_cannot_be_is_refused() {
        for line in [
            "probe a.exr -o b.exr --from latlong --circle 1,2,3",
            "probe a.exr -o b.exr --from angular --distance 5",
            "probe a.exr -o b.exr --circle 1,2",
            "probe a.exr -o b.exr --circle here",
            "probe a.exr -o b.exr --fov wide",
            "probe a.exr -o b.exr --second b.exr --angle ninety",
            "probe a.exr -o b.exr --fov 361",
            "probe a.exr -o b.exr --distance 0.5",
            "probe a.exr -o b.exr --turn nan",
            "probe a.exr -o b.exr --angle 90",
            "probe a.exr -o b.bmp",
        ] {
            assert!(plan(line).is_err(), "{line}");
        }
    }
}
