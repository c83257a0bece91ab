//! Photographs -> an asset -> four headings of a light in one pass over the field.
//!
//! `cargo run --release -p relume-core --example relight-in-rust -- [OUT]`, from the project's root.

use std::f32::consts::PI;
use std::path::{Path, PathBuf};

use relume_core::Result;
use relume_core::acquire::{ImportLp, Measured};
use relume_core::domain::lp::Lengths;
use relume_core::field::{Access, Asset, Precision};
use relume_core::illumination::EnvMap;
use relume_core::image::{self, ColourSpace, EncodeOptions, Encoding, Window};
use relume_core::relight::{Light, Look, Relighter, Weights};

fn main() -> Result<()> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let out = std::env::args().nth(1).map_or_else(|| root.join("target/examples/02"), PathBuf::from);
    std::fs::create_dir_all(&out).map_err(|source| relume_core::Error::io("create", &out, source))?;

    let asset = out.join("ball.rfield");
    let import = ImportLp {
        lp: root.join("examples/ball-24/dirs.lp"),
        encoding: Encoding::Auto,
        colour_space: ColourSpace::default(),
        black: None,
        alpha: None,
        irradiance: PI,
        measured: Measured::default(),
        precision: Precision::Half,
        lengths: Lengths::Unit,
        exclude: Vec::new(),
        correction: None,
    };
    import.run(&asset, &mut |_, _| Ok(()))?;

    let relighter = Relighter::new(Asset::open(&asset, Access::Mapped)?)?;
    let chart = EnvMap::load(&root.join("presets/charts/six-poles.png"))?;
    let looks: Vec<Look> =
        [0.0, 90.0, 180.0, 270.0].map(|heading_deg| Look { heading_deg, exposure_ev: 1.0, ..Look::default() }).into();
    let weights: Vec<Weights> =
        looks.iter().map(|look| relighter.weights(Light::Map(&chart), look)).collect::<Result<_>>()?;
    let lights: Vec<(&Weights, &Look)> = weights.iter().zip(&looks).collect();
    let window = Window::full(relighter.asset().width(), relighter.asset().height());
    for (picture, look) in relighter.render_many(&lights, window)?.iter().zip(&looks) {
        let path = out.join(format!("ball-{}.png", look.heading_deg));
        image::write(&path, picture, EncodeOptions::default())?;
    }
    Ok(())
}
