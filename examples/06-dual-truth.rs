//! A dual picture of the virtual gantry's still life, held against the same scene rendered from the projector:
//! `cargo run --release -p relume-core --example dual-truth -- ASSET POSITION white|IMAGE DUAL.exr SHEET.png`.
//!
//! `... -- trace ASSET NEW.rfield` writes the field of the same positions and squares without camera and noise, light over other
//! surfaces by squares (the virtual rig keeps it by blocks of them). `06-dual.sh` does both.

use std::path::Path;

use relume_core::acquire::Photographs;
use relume_core::field::{self, Access, Asset, Contents, Precision};
use relume_core::image::{self, EncodeOptions, Encoding, Image};
use relume_core::simulate::{Camera, Gantry, Quality};
use relume_core::{Error, Result};

/// How large a square is on the sheet.
const SCALE: usize = 12;
/// Squares brighter than this share of them do not count: whether the projector's lens shows in the mirror ball is chance.
const COUNTED: f64 = 0.99;

#[expect(clippy::print_stdout, reason = "what an example has to say")]
fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if let [word, asset, output] = &arguments[..]
        && word == "trace"
    {
        return traced(&Asset::open(Path::new(asset), Access::Mapped)?, Path::new(output));
    }
    let [asset, position, lit, dual, sheet] = &arguments[..] else {
        return Err(Error::invalid("arguments", arguments.join(" "), "ASSET POSITION white|IMAGE DUAL.exr SHEET.png"));
    };
    let asset = Asset::open(Path::new(asset), Access::Mapped)?;
    let position = position.parse().ok().filter(|n: &usize| *n > 0).unwrap_or(1) - 1;
    let (width, height) = (asset.width(), asset.height());
    let lit = match lit.as_str() {
        "white" => Image::from_fn(width, height, |_, _| [1.0; 3]),
        path => image::read(Path::new(path), Encoding::Auto)?.into_rgb(),
    };
    let found = image::read(Path::new(dual), Encoding::Auto)?.into_rgb();
    let truth = rendered(&asset, position, &lit)?;
    let (error, scale) = difference(&found, &truth);
    println!(
        "{dual}: {:.1} % from the render, up to one scale, {:.0} % of the squares",
        100.0 * error,
        100.0 * COUNTED
    );

    // The dual picture at the left, the render at the right.
    let (columns, rows) = truth.size();
    let white = brightest(&truth, 0.98) as f32;
    let side = |x: usize, y: usize| -> [f32; 3] {
        let (picture, gain) = if x < columns { (&found, scale as f32) } else { (&truth, 1.0) };
        std::array::from_fn(|c| picture.pixel(x % columns, y)[c] * gain / white)
    };
    let picture = Image::from_fn(2 * columns * SCALE, rows * SCALE, |x, y| side(x / SCALE, y / SCALE));
    image::write(Path::new(sheet), &picture, EncodeOptions::default())
}

/// The virtual gantry of an asset's positions and squares.
fn gantry(asset: &Asset) -> Result<Gantry> {
    let Some(domain) = asset.domain().gantry() else {
        return Err(Error::invalid(asset.path().display().to_string(), "another rig", "a virtual gantry"));
    };
    Ok(Gantry {
        positions: domain.poses().iter().map(|pose| pose.place.cast()).collect(),
        view_rad: domain.view_rad() as f32,
        blocks: domain.side(),
        ..Gantry::demo(Camera::gantry(asset.width(), asset.height()), (1, 1), domain.side())
    })
}

/// The field of the gantry as it is traced.
fn traced(asset: &Asset, output: &Path) -> Result<()> {
    let gantry = gantry(asset)?;
    let quality = Quality { samples: 64, stride: 1, ..Quality::rig() };
    let rows = gantry.trace(&quality, &mut |_, _| Ok(()))?;
    let (width, height) = rows.size();
    let mut photographs = Photographs::new(width, height, output.parent().unwrap_or(Path::new(".")));
    for element in 0..rows.grids().elements() {
        photographs.push(rows.element(element)?)?;
    }
    let contents = Contents {
        domain: gantry.domain()?.into(),
        irradiance: vec![1.0; gantry.positions.len()],
        width,
        height,
        colour_space: Default::default(),
        precision: Precision::Half,
        largest: photographs.largest(),
        // Nothing else shines there.
        ambient: Some(Image::new(width, height, 3)),
        alpha: None,
        reliability: None,
        provenance: serde_json::json!({"source": "traced"}),
    };
    field::write(output, &contents, &mut photographs)
}

/// The scene from the projector, lit by the camera.
fn rendered(asset: &Asset, position: usize, lit: &Image) -> Result<Image> {
    // What the mirror ball throws on the table comes from few directions.
    let quality = Quality { samples: 256, cone_density: 50_000.0, ..Quality::rig() };
    gantry(asset)?.from_projector(position, lit, &quality, &mut |_, _| Ok(()))
}

/// The relative error of what counts, and the scale that makes it least.
fn difference(found: &Image, truth: &Image) -> (f64, f64) {
    let most = [found, truth].map(|picture| brightest(picture, COUNTED));
    let sum = |picture: &Image, n: usize| picture.data()[3 * n..3 * n + 3].iter().map(|v| f64::from(*v)).sum::<f64>();
    let counts = |n: &usize| sum(found, *n) <= most[0] && sum(truth, *n) <= most[1];
    let numbers = || (0..truth.data().len() / 3).filter(counts).flat_map(|n| 3 * n..3 * n + 3);
    let inner =
        |a: &Image, b: &Image| -> f64 { numbers().map(|n| f64::from(a.data()[n]) * f64::from(b.data()[n])).sum() };
    let scale = inner(found, truth) / inner(found, found);
    let squared = |n: usize| (scale * f64::from(found.data()[n]) - f64::from(truth.data()[n])).powi(2);
    ((numbers().map(squared).sum::<f64>() / inner(truth, truth)).sqrt(), scale)
}

/// The sum of the channels that this share of the pixels does not exceed.
fn brightest(picture: &Image, share: f64) -> f64 {
    let mut sums: Vec<f64> =
        picture.data().chunks_exact(3).map(|rgb| rgb.iter().map(|v| f64::from(*v)).sum()).collect();
    sums.sort_unstable_by(f64::total_cmp);
    sums[((sums.len() - 1) as f64 * share) as usize]
}
