//! `relume inspect`: reflectance functions of pixels as pictures, raw and reconstructed (Peers 2006, figures 2.14 and 4.7).

use std::path::PathBuf;

use clap::Args;
use clap::builder::{PossibleValue, PossibleValuesParser};
use relume_core::domain::{Axis, Directions, Plane};
use relume_core::field::{Access, Asset};
use relume_core::image::{self, EncodeOptions, Image, Window};
use relume_core::math::{Vec3, angle_between};
use relume_core::reconstruct::{Method, Reconstruction};
use relume_core::relight::{Weights, apply};

use super::values;
use crate::drawing::{Canvas, LINE};
use crate::progress::{Progress, Unit};
use crate::projection::Projection;
use crate::sheet;

const EXAMPLES: &str = "\
Examples:
  relume inspect vase.rfield --pixel 120,88 -o pixel.png
  relume inspect vase.rfield --pixel 120,88 --pixel 40,12 --on latlong --reconstruct zero-order --reconstruct linear -o sheet.png

A row a pixel: what was sampled, a dot a lamp, then each reconstruction. A row is exposed so that its 98th percentile is white.
The disc (nusselt) shows the hemisphere about the lamps' axis, seen from outside: +x right, and +y up for lamps before the
object, +z (the camera's side) down for lamps above it. The map (latlong) is what an observer at the object sees: +x left.
Of a screen a row is its texels; of a projector a picture a position, as the projector sees the scene: what the pixel
answers to, its largest answer white.";

/// Room around things, in pixels.
const MARGIN: usize = 14;
/// The thumbnail fits into this.
const THUMBNAIL: (usize, usize) = (320, 240);
/// Reconstructions side by side before the row wraps.
const ACROSS: usize = 4;
/// Pictures of a screen or projector are enlarged to about this many pixels, and stand so many side by side.
const PICTURE: usize = 128;
const PICTURES_ACROSS: usize = 8;
/// Dots are this share of the spacing of the lamps wide, to each side.
const DOT: f64 = 0.4;
/// Linear greys of the sheet, and of what is not covered.
const PAPER: [f32; 3] = [0.015; 3];
const EMPTY: [f32; 3] = [0.05, 0.05, 0.065];

/// Raw flags.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// The captured object: a .rfield file.
    asset: PathBuf,
    /// A pixel: column and row from the top left, from 0. Give several for several rows.
    #[arg(long = "pixel", value_name = "X,Y", required = true, allow_hyphen_values = true, value_parser = values::pixel)]
    pixels: Vec<[usize; 2]>,
    /// How directions are laid out.
    #[arg(long, value_enum, default_value_t = Projection::Nusselt)]
    on: Projection,
    /// How the function is filled in between the lamps. Give several to compare them [default: linear].
    #[arg(long = "reconstruct", value_name = "METHOD", value_parser = methods())]
    methods: Vec<String>,
    /// The picture to write (.png 8-bit; .exr and others as `relume relight`).
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
}

fn methods() -> PossibleValuesParser {
    PossibleValuesParser::new(Method::ALL.iter().map(|method| PossibleValue::new(method.id()).help(method.label())))
}

/// A pixel's reflectance function.
struct Row {
    pixel: [usize; 2],
    samples: Vec<[f32; 3]>,
    /// What brings its 98th percentile to white.
    exposure: f32,
}

impl Arguments {
    /// Draws and writes.
    pub fn run(self) -> anyhow::Result<String> {
        image::check_output(&self.output)?;
        let asset = Asset::open(&self.asset, Access::Mapped)?;
        let rows = self.pixels.iter().map(|pixel| Row::read(&asset, *pixel)).collect::<anyhow::Result<Vec<_>>>()?;
        if let Some(picture) = asset.domain().picture() {
            if !self.methods.is_empty() {
                anyhow::bail!("--reconstruct: texels and squares are seen as they are; nothing lies between them");
            }
            let sheet = pictures(&asset, picture, &rows)?;
            return self.written(&sheet, rows.len(), &format!("each with {}", asset.domain().elements()));
        }
        let chosen = |method: &Method| self.methods.iter().any(|id| id == method.id());
        let chosen: Vec<Method> = match self.methods.is_empty() {
            true => vec![Method::Linear],
            false => Method::ALL.iter().copied().filter(chosen).collect(),
        };
        let rebuilt: Vec<Reconstruction> = chosen
            .into_iter()
            .map(|method| Reconstruction::new(asset.directions()?.clone(), method))
            .collect::<relume_core::Result<_>>()?;
        let sheet = Sheet { projection: self.on, rebuilt: &rebuilt, rows: &rows }.draw(&asset)?;
        self.written(&sheet, rows.len(), self.on.words(asset.directions()?.axis()))
    }

    fn written(&self, sheet: &Image, rows: usize, words: &str) -> anyhow::Result<String> {
        image::write(&self.output, sheet, EncodeOptions { png8: true, ..EncodeOptions::default() })?;
        let pixels = if rows == 1 { "pixel" } else { "pixels" };
        Ok(format!("{}: {rows} {pixels}; {words}\n", self.output.display()))
    }
}

/// For each pixel its answers to the texels of a screen, or to the squares of each position of a projector.
fn pictures(asset: &Asset, picture: Plane, rows: &[Row]) -> anyhow::Result<Image> {
    let ((columns, down), count) = (picture.size(), asset.domain().len() / picture.len());
    let enlarged = (PICTURE / columns.max(down)).max(1);
    let (w, h) = (columns * enlarged, down * enlarged);
    let across = count.min(PICTURES_ACROSS);
    let row_height = LINE + count.div_ceil(across) * (h + LINE) + MARGIN;
    let words = rows.iter().zip(1..).map(|(row, n)| row.words(n)).collect::<Vec<_>>();
    let beside = words.iter().map(|line| Canvas::width_of(line)).max().unwrap_or(0);
    let mut canvas =
        Canvas::new((across * (w + MARGIN)).max(beside + MARGIN) + MARGIN, MARGIN + rows.len() * row_height, PAPER);
    let mut progress = Progress::new("drawing", Unit::Steps);
    for (n, (row, words)) in rows.iter().zip(&words).enumerate() {
        let top = MARGIN + n * row_height;
        canvas.text((MARGIN, top), words);
        // A pixel answers to few squares: the percentile of a row would show what noise there is in the others.
        let largest = row.samples.as_flattened().iter().fold(f32::MIN_POSITIVE, |most, v| most.max(*v));
        for (position, answers) in row.samples.chunks_exact(picture.len()).enumerate() {
            let at = (MARGIN + position % across * (w + MARGIN), top + LINE + position / across * (h + LINE));
            canvas.fill(at, (w, h), |x, y| {
                Some(answers[picture.element(x / enlarged, y / enlarged)].map(|v| v / largest))
            });
            if count > 1 {
                canvas.text((at.0, at.1 + h + 1), &format!("position {}", position + 1));
            }
        }
        progress.step(n as u64 + 1, rows.len() as u64)?;
    }
    Ok(canvas.into_picture())
}

impl Row {
    fn read(asset: &Asset, pixel: [usize; 2]) -> anyhow::Result<Self> {
        let terms = asset.sparse().filter(|_| asset.domain().picture().is_some() && asset.samples().is_err());
        let samples = match terms {
            Some(terms) => terms.reflectance(pixel[0], pixel[1])?,
            None => asset.samples()?.reflectance(pixel[0], pixel[1])?,
        };
        let picture = Image::from_data(samples.len(), 1, 3, samples.as_flattened().to_vec())?;
        Ok(Self { pixel, samples, exposure: sheet::exposure(&picture) })
    }

    fn words(&self, number: usize) -> String {
        let lights = self.samples.iter().map(|rgb| rgb.iter().sum::<f32>() / 3.0);
        let (sum, most) = lights.fold((0.0f32, f32::NEG_INFINITY), |(sum, most), v| (sum + v, most.max(v)));
        let mean = sum / self.samples.len() as f32;
        format!("{number}  pixel {},{}   largest {most:.4}, mean {mean:.4}", self.pixel[0], self.pixel[1])
    }
}

/// What goes on the sheet.
struct Sheet<'a> {
    projection: Projection,
    rebuilt: &'a [Reconstruction],
    rows: &'a [Row],
}

impl Sheet<'_> {
    fn draw(&self, asset: &Asset) -> anyhow::Result<Image> {
        let (w, h) = self.projection.size();
        let axis = asset.directions()?.axis();
        let panels = 1 + self.rebuilt.len();
        let (across, lines) = (panels.min(ACROSS), panels.div_ceil(ACROSS));
        let row_height = LINE + lines * (h + LINE) + MARGIN;
        let thumbnail = thumbnail(asset)?;
        let name = asset.path().file_name().unwrap_or_default().to_string_lossy().into_owned();
        let words = [name, format!("{} lamps", asset.directions()?.len()), self.projection.words(axis).to_owned()];
        let beside = words.iter().map(|line| Canvas::width_of(line)).max().unwrap_or(0);
        let width = (across * (w + MARGIN)).max(thumbnail.width() + MARGIN + beside + MARGIN) + MARGIN;
        let top = thumbnail.height().max(4 * LINE) + 2 * MARGIN;
        let mut canvas = Canvas::new(width, top + self.rows.len() * row_height, PAPER);

        canvas.fill((MARGIN, MARGIN), thumbnail.size(), |x, y| {
            let p = thumbnail.pixel(x, y);
            Some([p[0], p[1], p[2]])
        });
        for (row, number) in self.rows.iter().zip(1..) {
            let place = |p: usize, shown: usize, all: usize| MARGIN + (2 * p + 1) * shown / (2 * all);
            let (sw, sh) = thumbnail.size();
            canvas.mark(
                (place(row.pixel[0], sw, asset.width()), place(row.pixel[1], sh, asset.height())),
                &number.to_string(),
            );
        }
        for (line, n) in words.iter().zip(0..) {
            canvas.text((2 * MARGIN + thumbnail.width(), MARGIN + n * LINE), line);
        }
        let mut progress = Progress::new("drawing", Unit::Steps);
        for (n, row) in self.rows.iter().enumerate() {
            let y = top + n * row_height;
            canvas.text((MARGIN, y), &row.words(n + 1));
            for panel in 0..panels {
                let at = (MARGIN + panel % ACROSS * (w + MARGIN), y + LINE + panel / ACROSS * (h + LINE));
                self.panel(&mut canvas, at, row, asset.directions()?, panel);
                progress.step((n * panels + panel + 1) as u64, (self.rows.len() * panels) as u64)?;
            }
        }
        Ok(canvas.into_picture())
    }

    /// Panel 0 is what was sampled, the others are the reconstructions.
    fn panel(&self, canvas: &mut Canvas, at: (usize, usize), row: &Row, domain: &Directions, panel: usize) {
        let (w, h) = self.projection.size();
        let axis = domain.axis();
        let direction = |x: usize, y: usize| {
            let place = ((x as f64 + 0.5) / w as f64, (y as f64 + 0.5) / h as f64);
            self.projection.direction(place, axis)
        };
        let lit = |rgb: [f32; 3]| rgb.map(|v| v * row.exposure);
        let caption = match panel.checked_sub(1).and_then(|n| self.rebuilt.get(n)) {
            None => {
                let radius = DOT * domain.median_spacing();
                canvas.fill(at, (w, h), |x, y| direction(x, y).map(|d| lit(dot(&d, row, domain, radius))));
                "lamps".to_owned()
            }
            Some(reconstruction) => {
                let places: Vec<Option<Vec3>> =
                    (0..w * h).map(|i| direction(i % w, i / w).filter(|d| domain.covers(d))).collect();
                let directions: Vec<Vec3> = places.iter().flatten().copied().collect();
                let channel = |c: usize| {
                    let samples: Vec<f32> = row.samples.iter().map(|rgb| rgb[c]).collect();
                    reconstruction.values(&samples, &directions)
                };
                let [r, g, b] = [channel(0), channel(1), channel(2)];
                let mut values = (0..directions.len()).map(|n| lit([r[n], g[n], b[n]]));
                let colours: Vec<Option<[f32; 3]>> =
                    places.iter().map(|place| place.and_then(|_| values.next())).collect();
                canvas.fill(at, (w, h), |x, y| direction(x, y).map(|_| colours[y * w + x].unwrap_or(EMPTY)));
                reconstruction.method().label().to_owned()
            }
        };
        canvas.text((at.0, at.1 + h + 1), &caption);
        self.name_poles(canvas, at, axis);
    }

    /// Names of the axes, just inside the panel.
    fn name_poles(&self, canvas: &mut Canvas, at: (usize, usize), axis: Axis) {
        let (w, h) = self.projection.size();
        for (name, direction) in self.projection.poles(axis) {
            let Some((u, v)) = self.projection.place(&Vec3::from(*direction), axis) else { continue };
            let (width, height) = (Canvas::width_of(name), LINE - 4);
            let x = ((u * w as f64) as usize).saturating_sub(width / 2).min(w - width);
            let y = ((v * h as f64) as usize).saturating_sub(height / 2).min(h - height);
            canvas.text((at.0 + x, at.1 + y), name);
        }
    }
}

/// The sample of the lamp whose dot covers a direction; paper between them.
fn dot(direction: &Vec3, row: &Row, domain: &Directions, radius: f64) -> [f32; 3] {
    let lamp = domain.nearest(direction);
    let near = angle_between(direction, &domain.lamps()[lamp]) <= radius;
    if near { row.samples[lamp] } else { EMPTY.map(|v| v / row.exposure) }
}

/// The object under all lamps at once, averaged down or repeated up to fit.
fn thumbnail(asset: &Asset) -> anyhow::Result<Image> {
    let lamps = asset.directions()?.len();
    let all = Weights::of_lamps(vec![[1.0 / lamps as f32; 3]; lamps]);
    let mut pictures = apply(asset.samples()?, &[&all], Window::full(asset.width(), asset.height()))?;
    let Some(mut whole) = pictures.pop() else { anyhow::bail!("no picture") };
    let exposure = sheet::exposure(&whole);
    whole.data_mut().iter_mut().for_each(|v| *v *= exposure);
    let (w, h) = whole.size();
    let fit = (THUMBNAIL.0 as f64 / w as f64).min(THUMBNAIL.1 as f64 / h as f64);
    let side = |n: usize| ((n as f64 * fit).round() as usize).max(1);
    let (tw, th) = (side(w), side(h));
    let span = |i: usize, shown: usize, all: usize| {
        let from = i * all / shown;
        from..((i + 1) * all / shown).clamp(from + 1, all.max(from + 1))
    };
    Ok(Image::from_fn(tw, th, |x, y| {
        let (columns, rows) = (span(x, tw, w), span(y, th, h));
        let count = (columns.len() * rows.len()) as f32;
        let pixels = rows.flat_map(|sy| columns.clone().map(move |sx| (sx, sy)));
        let sum = pixels.fold([0.0f32; 3], |sum, (sx, sy)| {
            let p = whole.pixel(sx, sy);
            [sum[0] + p[0], sum[1] + p[1], sum[2] + p[2]]
        });
        sum.map(|v| v / count)
    }))
}
