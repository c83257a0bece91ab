//! `relume demo`: the main job on the virtual stage, with a truth to hold it against.
//!
//! A still life is photographed under every lamp of a dome and stored as an asset; the asset is relit under a sky, a window
//! and a strip; the same scene is lit directly by the same maps. What differs between the two is printed.

use std::f64::consts::FRAC_PI_2;
use std::fmt::Write;
use std::path::{Path, PathBuf};

use clap::Args;
use relume_core::Error;
use relume_core::domain::Directions;
use relume_core::evaluate::compare;
use relume_core::field::{self, Access, Asset, Contents, Precision};
use relume_core::illumination::EnvMap;
use relume_core::image::{self, EncodeOptions, Image, Window};
use relume_core::math::Vec3;
use relume_core::reconstruct::Method;
use relume_core::relight::{Light, Look, Relighter, Weights};
use relume_core::simulate::{
    Camera, Class, ClassMap, Quality, Scene, Stage, classes, demo_lamps, grid_lamps, lights, truth,
};

use super::values;
use crate::progress::{Progress, Unit};
use crate::sheet;

const EXAMPLES: &str = "\
Examples:
  relume demo
  relume demo --out /tmp/still-life --width 320
  relume demo --out /tmp/grid --grid 64x20

Under the window and the strip, mirror and glass differ much more than the rest: they show the lamps' cells, about 3 degrees
wide, in place of the light itself. That is what a stage cannot sample (Peers 2006, 4.2).";

/// Lamps of the dome: cells of 2.8 degrees, small against the lights and the penumbrae they cast.
const LAMPS: usize = 2560;
/// Columns and rows of the lights' maps: 0.7 degrees a texel, edges averaged over the texel.
const MAP_SIZE: (usize, usize) = (512, 256);

/// Raw flags.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// The folder to write to; it is made if it does not exist.
    #[arg(long, value_name = "DIR", default_value = "relume-demo")]
    out: PathBuf,
    /// Columns of the pictures; rows are three quarters. Time, and the size of the asset, grow with the square.
    #[arg(long, value_name = "PIXELS", default_value_t = 192, value_parser = clap::value_parser!(u16).range(16..=1920))]
    width: u16,
    /// Lamps on a grid of so many longitudes x latitudes, as an arc above a turntable gives them, in place of 2560 evenly spread
    /// ones: for methods that need a grid.
    #[arg(long, value_name = "LONxLAT", value_parser = grid)]
    grid: Option<(usize, usize)>,
}

/// Lamps at most: four times the plain demonstration's.
const MOST_LAMPS: usize = 4 * LAMPS;

fn grid(text: &str) -> Result<(usize, usize), String> {
    let (longitudes, latitudes) = values::grid(text)?;
    if longitudes < 4 || latitudes < 2 {
        return Err("fewer than 4 longitudes or 2 latitudes".to_owned());
    }
    let fits = usize::checked_mul(longitudes, latitudes).is_some_and(|lamps| lamps <= MOST_LAMPS);
    if fits { Ok((longitudes, latitudes)) } else { Err(format!("more than {MOST_LAMPS} lamps")) }
}

/// A light, and the picture of it that was made without the stage.
struct Case {
    name: &'static str,
    map: EnvMap,
}

impl Arguments {
    /// Renders, packs, relights, compares.
    pub fn run(self) -> anyhow::Result<String> {
        std::fs::create_dir_all(&self.out).map_err(|source| Error::io("create", &self.out, source))?;
        let (width, height) = (usize::from(self.width), usize::from(self.width) * 3 / 4);
        let (scene, camera) = (Scene::demo(), Camera::demo(width, height));
        let lamps =
            self.grid.map_or_else(|| demo_lamps(LAMPS), |(longitudes, latitudes)| grid_lamps(longitudes, latitudes));
        let lamps = Directions::new(lamps)?;
        let seen = classes(&scene, &camera);
        let path = self.out.join("asset.rfield");
        photograph(&scene, camera, &lamps, &seen, &path)?;

        let cases = cases()?;
        let maps: Vec<EnvMap> = cases.iter().map(|case| case.map.clone()).collect();
        let mut progress = Progress::new("lighting the scene directly", Unit::Steps);
        let truths =
            truth(&scene, &camera, &maps, &lamps, &Quality::truth(), &mut |done, total| progress.step(done, total))?;
        drop(progress);

        let relit = relight(&path, &maps)?;
        image::write(&self.out.join("relit.exr"), &relit[0], EncodeOptions::default())?;
        image::write(&self.out.join("relit.png"), &relit[0], EncodeOptions::default())?;
        let relit: Vec<Image> = relit.into_iter().map(Image::into_rgb).collect();
        for ((case, picture), truth) in cases.iter().zip(&relit).zip(&truths) {
            image::write(&self.out.join(format!("{}-relit.exr", case.name)), picture, EncodeOptions::default())?;
            image::write(&self.out.join(format!("{}-direct.exr", case.name)), truth, EncodeOptions::default())?;
        }
        let sheet = sheet::contact_sheet(&relit, &truths);
        image::write(&self.out.join("contact-sheet.png"), &sheet, EncodeOptions { png8: true, ..Default::default() })?;
        report(&self.out, &cases, &relit, &truths, &seen)
    }
}

/// The sky, a window 10 degrees square, and an upright strip 5 degrees wide from the horizon to the zenith.
fn cases() -> relume_core::Result<Vec<Case>> {
    let towards = |heading: f64, elevation: f64| {
        let ((s, c), (up, out)) = (heading.to_radians().sin_cos(), elevation.to_radians().sin_cos());
        Vec3::new(s * out, up, c * out)
    };
    let middle = towards(60.0, 45.0);
    let (window, strip) = (10f64.to_radians(), 5f64.to_radians());
    Ok(vec![
        Case { name: "sky", map: lights::sky(MAP_SIZE) },
        Case { name: "window", map: lights::window(MAP_SIZE, &towards(40.0, 45.0), window, [20.0; 3])? },
        Case { name: "strip", map: lights::strip(MAP_SIZE, &middle, &Vec3::y(), strip, FRAC_PI_2, [5.0; 3])? },
    ])
}

/// One photograph a lamp, streamed into the container.
fn photograph(scene: &Scene, camera: Camera, lamps: &Directions, seen: &ClassMap, path: &Path) -> anyhow::Result<()> {
    let quality = Quality::default();
    let stage = Stage::new(scene, camera, lamps, quality);
    let contents = Contents {
        colour_space: Default::default(),
        domain: lamps.clone().into(),
        irradiance: vec![std::f32::consts::PI; lamps.len()],
        width: camera.width,
        height: camera.height,
        precision: Precision::Half,
        largest: stage.largest(),
        ambient: None,
        alpha: Some(seen.alpha.clone()),
        reliability: None,
        provenance: serde_json::json!({
            "source": "virtual stage", "scene": "demo", "lamps": lamps.len(), "samples": quality.samples,
            "bounces": quality.bounces, "depth": quality.depth, "seed": quality.seed,
        }),
    };
    let mut progress = Progress::new("photographing under every lamp", Unit::Steps);
    field::write(path, &contents, &mut stage.bands(&mut |done, total| progress.step(done, total)))?;
    Ok(())
}

/// All maps in one pass over the asset, as RGBA. The lamps fill their cells, so zero-order is exact for light that is
/// constant over each.
fn relight(path: &Path, maps: &[EnvMap]) -> relume_core::Result<Vec<Image>> {
    let relighter = Relighter::new(Asset::open(path, Access::Mapped)?)?;
    let look = Look { method: Method::ZeroOrder, ..Look::default() };
    let weights: Vec<Weights> =
        maps.iter().map(|map| relighter.weights(Light::Map(map), &look)).collect::<relume_core::Result<_>>()?;
    let lights: Vec<(&Weights, &Look)> = weights.iter().map(|w| (w, &look)).collect();
    let window = Window::full(relighter.asset().width(), relighter.asset().height());
    relighter.render_many(&lights, window)
}

/// The table of differences, and what lies where.
fn report(out: &Path, cases: &[Case], relit: &[Image], truths: &[Image], seen: &ClassMap) -> anyhow::Result<String> {
    let groups = [
        ("diffuse", vec![Class::Diffuse]),
        ("glossy", vec![Class::Glossy]),
        ("mirror and glass", vec![Class::Mirror, Class::Glass]),
    ];
    let mut text = String::from("Relit against lit directly, relative L2 error (noise of both included):\n\n");
    write!(text, "  {:8}", "light")?;
    for (name, classes) in &groups {
        write!(text, "{:>29}", format!("{name} ({} px)", seen.pixels(classes).len()))?;
    }
    for ((case, picture), truth) in cases.iter().zip(relit).zip(truths) {
        write!(text, "\n  {:8}", case.name)?;
        for (_, classes) in &groups {
            let shown = |x: usize, y: usize| f32::from(classes.contains(&seen.class[y * seen.width + x]));
            let mask = Image::from_fn(seen.width, seen.height, |x, y| [shown(x, y); 3]);
            write!(text, "{:>27.2} %", 100.0 * compare(picture, truth, Some(&mask))?.relative_l2)?;
        }
    }
    write!(
        text,
        "\n\nMirror and glass show the lamps' cells in place of a narrow light: a stage must alias there (4.2).\n\n\
         In {}: asset.rfield; relit.exr and .png (sky); contact-sheet.png (relit | direct | difference x 4, a row a light)\n",
        out.display()
    )?;
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grids_are_longitudes_by_latitudes() {
        assert_eq!(grid("64x20"), Ok((64, 20)));
        for bad in ["64", "64x", "x20", "64x20x3", "-64x20", "3x20", "64x1", "0x0", "1000x1000", "6.4x20", ""] {
            assert!(grid(bad).is_err(), "{bad}");
        }
    }
}
