//! The picture: `T L + g S + (1 - alpha) plate`, L what the plate shows where the screen stood.

use std::sync::Arc;

use relume_core::image::{Image as Picture, Window};
use relume_core::matte::{Composite, Show};
use relume_core::relight::{Look, ScreenRelighter, Weights};

use super::backplate::Grid;
use super::controls::Controls;
use super::library::{Instance, Library, Scene};
use super::source;
use crate::area::Axis;
use crate::effects::canvas::{self, BAND, Canvas};
use crate::effects::regions;
use crate::effects::request::{self, Request};
use crate::error::{Error, Result};
use crate::host::{Call, Depth, Effect, Reply};
use crate::pool::Pool;

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
    let clip = source(effect);
    let plate = clip.as_ref().map_or(Ok(None), |clip| clip.image(request.time))?;
    let plate = plate.ok_or(Error::Missing("Connect the backplate to Source: it is the light of the object."))?;
    let told = regions::plate(effect, clip.as_ref(), request.time);
    let region = regions::seen(told, Some(&plate), request.scale);
    let grid = Grid::of(&plate, region, request.scale, canvas.layout().aspect)?;
    let (place, look) = (grid.place(&controls.place), controls.look);
    let weights = match controls.show {
        Show::Alpha => Arc::new(dark(&field, &look)?),
        Show::Composite | Show::Element => {
            let around = library.around(instance, &controls.beyond)?;
            let scene = Scene { field: &field, grid: &grid, place, around: &around, look: &look };
            library.weights(&scene, grid.digest(&plate), || grid.read(&plate))?
        }
    };
    let size = (field.asset().width(), field.asset().height());
    let composite = Composite::new(size, &place, grid.size())?;
    let upright = place.rotate_deg.rem_euclid(90.0) == 0.0;
    let element = Element { field, weights, look, composite, show: controls.show, axes: grid.axes(), upright };
    canvas.draw(effect, &element, Some(&plate).filter(|_| controls.show == Show::Composite))
}

/// No light: coverage does not depend on it.
fn dark(field: &ScreenRelighter, look: &Look) -> Result<Weights> {
    let light = vec![[0.0; 3]; field.plane().len()];
    Ok(Pool::shared()?.run(|| field.weights(&light, look))?)
}

/// The lit object, placed.
struct Element {
    field: Arc<ScreenRelighter>,
    weights: Arc<Weights>,
    look: Look,
    composite: Composite,
    show: Show,
    axes: (Axis, Axis),
    upright: bool,
}

impl canvas::Element for Element {
    fn axes(&self) -> (Axis, Axis) {
        self.axes
    }

    fn pixels(&self, window: Window) -> Result<Picture> {
        Ok(self.composite.element(&self.field, (&self.weights, &self.look), window)?)
    }

    /// All at once where the object is turned: a band that lies across its picture needs most of it.
    fn band(&self) -> i32 {
        if self.upright { BAND } else { i32::MAX }
    }

    fn stored(&self, mut rgba: Vec<f32>, _columns: usize, _depth: Depth) -> Result<Vec<f32>> {
        if self.show == Show::Alpha {
            rgba.as_chunks_mut::<4>().0.iter_mut().for_each(|pixel| *pixel = [pixel[3]; 4]);
        }
        Ok(rgba)
    }
}
