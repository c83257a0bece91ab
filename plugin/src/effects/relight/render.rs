//! The picture: the asset lit, or one of its layers, centred on the plate.

use std::sync::Arc;

use relume_core::illumination::EnvMap;
use relume_core::image::{Image as Picture, Window};
use relume_core::relight::{Layer, Relighter, Weights, displayed_normals};

use super::controls::{Controls, Output};
use super::library::{Instance, Library, Lit};
use super::{ILLUMINATION, input};
use crate::area::Axis;
use crate::effects::canvas::{self, Canvas, read_row};
use crate::effects::placement::Placement;
use crate::effects::request::{self, Request};
use crate::effects::{SOURCE, regions};
use crate::error::{Error, Result};
use crate::host::{Call, Depth, Effect, Image, Layout, Reply};

/// A side beyond this is a host's way of saying "no end", not a map.
const LARGEST_MAP: usize = 1 << 17;

/// Renders, and shows or clears the message.
pub fn render(library: &Library, instance: &Instance, call: &Call<'_>) -> Reply {
    request::render(call, |request, canvas| picture(library, instance, &call.effect, request, canvas))
}

fn picture(
    library: &Library,
    instance: &Instance,
    effect: &Effect<'_>,
    request: &Request,
    canvas: &mut Canvas<'_>,
) -> Result<()> {
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
    let placement = placement(effect, request, &field, plate.as_ref());
    let axes = placement.axes(request.scale, canvas.layout().aspect);
    let plate = plate.filter(|_| controls.output == Output::Composite);
    canvas.draw(effect, &Element { field, weights, controls, axes }, plate.as_ref())
}

/// Centred on the plate's region; without a plate on its own.
fn placement(effect: &Effect<'_>, request: &Request, field: &Relighter, plate: Option<&Image<'_>>) -> Placement {
    let size = (field.asset().width(), field.asset().height());
    let told = regions::plate(effect, input(effect, SOURCE).as_ref(), request.time);
    match regions::seen(told, plate, request.scale) {
        Some(region) => Placement::centred(size, &region),
        None => Placement::own_format(size),
    }
}

/// The Illumination clip if it delivers an image, else the lamp, else light near the object, else the lighting file, else the
/// lighting, else the environment file.
fn light(library: &Library, instance: &Instance, effect: &Effect<'_>, controls: &Controls, time: f64) -> Result<Lit> {
    if let Some(map) = illumination(effect, time)? {
        return Ok(Lit::Clip(Arc::new(map)));
    }
    if let Some(lamp) = controls.lamp {
        return Ok(Lit::Lamp(lamp));
    }
    if controls.near.is_on() {
        return library.near(instance, &controls.near).map(Lit::Near);
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

/// The lit object, placed.
struct Element {
    field: Arc<Relighter>,
    /// `None` when a layer is shown, which needs no light.
    weights: Option<Arc<Weights>>,
    controls: Controls,
    axes: (Axis, Axis),
}

impl canvas::Element for Element {
    fn axes(&self) -> (Axis, Axis) {
        self.axes
    }

    /// A window of the full-size element or layer.
    fn pixels(&self, window: Window) -> Result<Picture> {
        match (&self.weights, self.controls.output) {
            (_, Output::Layer(layer)) => Ok(layer.picture(self.field.asset(), window)?),
            (Some(weights), _) => Ok(self.field.render(weights, &self.controls.look, window)?),
            (None, _) => Err(Error::host("asked for a picture without light")),
        }
    }

    fn stored(&self, rgba: Vec<f32>, columns: usize, depth: Depth) -> Result<Vec<f32>> {
        if self.controls.output != Output::Layer(Layer::Normals) || depth != Depth::Byte {
            return Ok(rgba);
        }
        let mut shown = Picture::from_data(columns, rgba.len() / (4 * columns), 4, rgba)?;
        displayed_normals(&mut shown);
        Ok(shown.data().to_vec())
    }
}
