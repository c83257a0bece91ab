//! The picture: bands of rows, each relit, scaled, composited and stored.
//!
//! A render that fails, is stopped or panics leaves the window cleared: some hosts show the buffer whatever we answer.

use std::sync::Arc;

use rayon::prelude::*;
use relume_core::illumination::EnvMap;
use relume_core::image::{Image as Picture, Window};
use relume_core::relight::{Layer, Relighter, Weights, displayed_normals};

use super::assets::{Library, Lit};
use super::controls::{Controls, Output};
use super::placement::Placement;
use super::{ILLUMINATION, Instance, OUTPUT, SOURCE, input, regions};
use crate::area::{self, Axis, Tap};
use crate::error::{Error, Result};
use crate::host::names::*;
use crate::host::{Call, Depth, Effect, Image, Layout, Properties, Rect, Reply};
use crate::pixels;
use crate::pool::Pool;

/// Rows of a band: enough work for all threads, little enough to stop soon.
const BAND: i32 = 128;

/// A side beyond this is a host's way of saying "no end", not a map.
const LARGEST_MAP: usize = 1 << 17;

/// Renders, and shows or clears the message.
pub fn render(library: &Library, instance: &Instance, call: &Call<'_>) -> Reply {
    match picture(library, instance, call) {
        Ok(()) => {
            call.effect.clear_error();
            Reply::Ok
        }
        // The host asked to stop and throws the picture away; it did not fail.
        Err(Error::Aborted) => Reply::Ok,
        Err(error) => {
            call.effect.show_error(&error.to_string());
            Reply::Failed
        }
    }
}

fn picture(library: &Library, instance: &Instance, call: &Call<'_>) -> Result<()> {
    let effect = &call.effect;
    let request = Request::read(call.args.ok_or_else(|| Error::host("gave no arguments to render"))?)?;
    let output = effect.clip(OUTPUT).map_or(Ok(None), |clip| clip.image(request.time))?;
    let mut canvas = Canvas::new(output.ok_or_else(|| Error::host("gave no output image"))?, request.window);
    request.refuse_fields()?;

    let controls = Controls::read(effect, request.time);
    let field = library.field(instance, &controls.asset)?;
    let weights = match controls.output {
        Output::Layer(_) => None,
        _ => {
            let light = light(library, instance, effect, &controls, request.time)?;
            Some(library.weights(&field, &light, &controls.look)?)
        }
    };
    let plate = input(effect, SOURCE);
    let plate = plate.map_or(Ok(None), |clip| clip.image(request.time))?;
    let placement = request.placement(effect, &field, plate.as_ref());
    let aspect = canvas.image.layout().aspect;
    let axes = placement.axes(request.scale, aspect);
    let plate = plate.filter(|_| controls.output == Output::Composite);
    let element = Element { field, weights, controls, axes };
    element.draw(effect, plate.as_ref(), &mut canvas)
}

/// The Illumination clip if it delivers an image, else the lamp, else the lighting file, else the lighting, else the
/// environment file.
fn light(library: &Library, instance: &Instance, effect: &Effect<'_>, controls: &Controls, time: f64) -> Result<Lit> {
    if let Some(map) = illumination(effect, time)? {
        return Ok(Lit::Clip(Arc::new(map)));
    }
    if let Some(lamp) = controls.lamp {
        return Ok(Lit::Lamp(lamp));
    }
    if let Some(file) = controls.lighting_file() {
        return library.lighting(instance, file).map(Lit::Beams);
    }
    match controls.lighting {
        Some(preset) => library.preset(preset).map(Lit::Beams),
        None => library.map(instance, &controls.environment).map(Lit::File),
    }
}

/// The map of the Illumination clip, rows downwards, alpha dropped.
fn illumination(effect: &Effect<'_>, time: f64) -> Result<Option<EnvMap>> {
    let clip = input(effect, ILLUMINATION);
    let Some(image) = clip.map_or(Ok(None), |clip| clip.image(time))? else { return Ok(None) };
    let Layout { bounds, region, .. } = *image.layout();
    let endless = region.width() > LARGEST_MAP || region.height() > LARGEST_MAP;
    let whole = if endless { bounds } else { region };
    if !bounds.covers(&whole) {
        return Err(Error::Host {
            what: "delivered only part of the Illumination".to_owned(),
            advice: "crop or reformat the map to its own size before this effect",
        });
    }
    let (width, height) = (whole.width(), whole.height());
    let mut data = Vec::with_capacity(width * height * 3);
    let mut row = vec![0.0; width * 4];
    for y in (whole.y1..whole.y2).rev() {
        read_row(&image, y, whole.x1, whole.x2, &mut row);
        data.extend(row.chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]));
    }
    Ok(Some(EnvMap::new(Picture::from_data(width, height, 3, data)?)?))
}

/// What the host asks for.
struct Request {
    time: f64,
    scale: (f64, f64),
    /// `None` asks for the whole output.
    window: Option<Rect<i32>>,
    field: Option<String>,
}

impl Request {
    fn read(args: Properties<'_>) -> Result<Self> {
        let [x, y] = args.doubles(kOfxImageEffectPropRenderScale).unwrap_or([1.0, 1.0]);
        if !(x > 0.0 && y > 0.0 && x.is_finite() && y.is_finite()) {
            return Err(Error::host(format!("asks for a render scale of {x} by {y}")));
        }
        Ok(Self {
            time: args.double(kOfxPropTime, 0).unwrap_or_default(),
            scale: (x, y),
            window: args.ints(kOfxImageEffectPropRenderWindow).map(|[x1, y1, x2, y2]| Rect { x1, y1, x2, y2 }),
            field: args.string(kOfxImageEffectPropFieldToRender, 0),
        })
    }

    /// Whole frames only; "both" is what progressive hosts say now and then.
    fn refuse_fields(&self) -> Result<()> {
        let single = [kOfxImageFieldLower, kOfxImageFieldUpper];
        match &self.field {
            Some(field) if single.iter().any(|f| f.to_bytes() == field.as_bytes()) => Err(Error::Host {
                what: "asks for a single field".to_owned(),
                advice: "set the project or the clip to progressive frames",
            }),
            _ => Ok(()),
        }
    }

    /// Centred on the plate's region as the clip tells it; on the image's where the clip does not; else on its own.
    fn placement(&self, effect: &Effect<'_>, field: &Relighter, plate: Option<&Image<'_>>) -> Placement {
        let size = (field.asset().width(), field.asset().height());
        let from_image = || {
            let Layout { region, aspect, .. } = *plate?.layout();
            let (x, y) = (|x: i32| f64::from(x) * aspect / self.scale.0, |y: i32| f64::from(y) / self.scale.1);
            Some(Rect { x1: x(region.x1), y1: y(region.y1), x2: x(region.x2), y2: y(region.y2) })
        };
        match regions::plate(effect, self.time).or_else(from_image) {
            Some(region) => Placement::centred(size, &region),
            None => Placement::own_format(size),
        }
    }
}

/// The output image, cleared unless it is finished.
struct Canvas<'a> {
    image: Image<'a>,
    window: Rect<i32>,
    finished: bool,
}

impl<'a> Canvas<'a> {
    fn new(image: Image<'a>, window: Option<Rect<i32>>) -> Self {
        let bounds = image.layout().bounds;
        Self { image, window: window.map_or(bounds, |window| window.clipped(&bounds)), finished: false }
    }
}

impl Drop for Canvas<'_> {
    fn drop(&mut self) {
        if self.finished {
            return;
        }
        for y in self.window.y1..self.window.y2 {
            if let Some(row) = self.image.row_mut(y, self.window.x1, self.window.x2) {
                row.fill(0);
            }
        }
    }
}

/// The lit object, placed.
struct Element {
    field: Arc<Relighter>,
    /// `None` when a layer is shown, which needs no light.
    weights: Option<Arc<Weights>>,
    controls: Controls,
    axes: (Axis, Axis),
}

impl Element {
    fn draw(&self, effect: &Effect<'_>, plate: Option<&Image<'_>>, canvas: &mut Canvas<'_>) -> Result<()> {
        let (pool, layout, window) = (Pool::shared()?, *canvas.image.layout(), canvas.window);
        let columns = self.axes.0.taps(window.x1, window.x2);
        let row_bytes = window.width() * layout.pixel_bytes();
        if row_bytes == 0 {
            canvas.finished = true;
            return Ok(());
        }
        for y1 in (window.y1..window.y2).step_by(BAND as usize) {
            if effect.aborted() {
                return Err(Error::Aborted);
            }
            let y2 = y1.saturating_add(BAND).min(window.y2);
            let under = plate.map(|plate| read_band(plate, &Rect { y1, y2, ..window }));
            let rows = self.axes.1.taps(y1, y2);
            let band = pool.run(|| self.band(&columns, &rows, under.as_deref(), &layout))?;
            for (y, stored) in (y1..y2).zip(band.chunks_exact(row_bytes)) {
                if let Some(row) = canvas.image.row_mut(y, window.x1, window.x2) {
                    row.copy_from_slice(stored);
                }
            }
        }
        canvas.finished = true;
        Ok(())
    }

    /// The stored bytes of some rows, without padding. Runs on our threads: no locks.
    fn band(&self, columns: &[Tap], rows: &[Tap], under: Option<&[f32]>, layout: &Layout) -> Result<Vec<u8>> {
        let window = area::window(columns, rows);
        let mut rgba = if window.is_empty() {
            vec![0.0; columns.len() * rows.len() * 4]
        } else {
            area::resample(&self.pixels(window)?, window, columns, rows)
        };
        if self.controls.output == Output::Layer(Layer::Normals) && layout.depth == Depth::Byte {
            let mut shown = Picture::from_data(columns.len(), rows.len(), 4, rgba)?;
            displayed_normals(&mut shown);
            rgba = shown.data().to_vec();
        }
        if let Some(under) = under {
            rgba.par_chunks_exact_mut(4).zip(under.par_chunks_exact(4)).for_each(|(e, s)| over(e, s));
        }
        let mut stored = vec![0; columns.len() * rows.len() * layout.pixel_bytes()];
        stored
            .par_chunks_mut(columns.len() * layout.pixel_bytes())
            .zip(rgba.par_chunks(columns.len() * 4))
            .for_each(|(stored, rgba)| pixels::encode(layout, rgba, stored));
        Ok(stored)
    }

    /// A window of the full-size element or layer, RGBA, rows downwards.
    fn pixels(&self, window: Window) -> Result<Picture> {
        match (&self.weights, self.controls.output) {
            (_, Output::Layer(layer)) => Ok(layer.picture(self.field.asset(), window)?),
            (Some(weights), _) => Ok(self.field.render(weights, &self.controls.look, window)?),
            (None, _) => Err(Error::host("asked for a picture without light")),
        }
    }
}

/// element + (1 - alpha) plate, both premultiplied. Where the element is opaque the plate counts for nothing, not even
/// as NaN.
fn over(element: &mut [f32], plate: &[f32]) {
    let through = 1.0 - element[3];
    if through != 0.0 {
        element.iter_mut().zip(plate).for_each(|(e, s)| *e += through * s);
    }
}

/// Linear premultiplied RGBA of a rectangle of an image, bottom row first; nothing outside the image's bounds.
fn read_band(image: &Image<'_>, rect: &Rect<i32>) -> Vec<f32> {
    let width = rect.width();
    let mut band = vec![0.0; width * rect.height() * 4];
    let inside = rect.clipped(&image.layout().bounds);
    if inside.width() == 0 {
        return band;
    }
    let left = (inside.x1 - rect.x1) as usize * 4;
    for y in inside.y1..inside.y2 {
        let start = (y - rect.y1) as usize * width * 4 + left;
        read_row(image, y, inside.x1, inside.x2, &mut band[start..start + inside.width() * 4]);
    }
    band
}

fn read_row(image: &Image<'_>, y: i32, x1: i32, x2: i32, out: &mut [f32]) {
    match image.row(y, x1, x2) {
        Some(bytes) => pixels::decode(image.layout(), bytes, out),
        None => out.fill(0.0),
    }
}

#[cfg(test)]
mod tests {
    use super::over;

    #[test]
    fn over_is_premultiplied_and_opaque_hides_everything() {
        let mut element = [0.5, 0.0, 2.0, 0.25];
        over(&mut element, &[1.0, 4.0, -2.0, 0.5]);
        assert_eq!(element, [1.25, 3.0, 0.5, 0.625]);
        let mut opaque = [0.5, 0.25, 0.125, 1.0];
        over(&mut opaque, &[f32::NAN, f32::INFINITY, 1.0, 1.0]);
        assert_eq!(opaque, [0.5, 0.25, 0.125, 1.0]);
        let mut nothing = [0.0; 4];
        over(&mut nothing, &[0.1, 0.2, 0.3, 0.4]);
        assert_eq!(nothing, [0.1, 0.2, 0.3, 0.4]);
    }
}
