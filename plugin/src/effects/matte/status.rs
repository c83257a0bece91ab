//! What is loaded, in words.

use relume_core::field::Kind;

use super::controls::{Beyond, Controls};
use super::library::{Around, Instance, Library};
use crate::effects::files::file_name;
use crate::effects::status::{Depth, EMPTY, Speaker};
use crate::error::Result;
use crate::host::Effect;

/// An instance with what it shares.
pub struct Voice<'a> {
    pub library: &'a Library,
    pub instance: &'a Instance,
}

impl Speaker for Voice<'_> {
    fn line(&self, effect: &Effect<'_>, time: f64, depth: Depth) -> Result<String> {
        let controls = Controls::read(effect, time);
        if controls.asset.trim().is_empty() {
            return Ok(EMPTY.to_owned());
        }
        let about = self.about(&controls)?;
        match &controls.beyond {
            Beyond::Stretch => Ok(format!("{about} Beyond the plate: its stretched edge.")),
            Beyond::Colour(_) => Ok(format!("{about} Beyond the plate: a colour.")),
            Beyond::Map(typed, ..) if depth == Depth::Asset && !typed.trim().is_empty() => {
                Ok(format!("{about} Beyond the plate: {}.", file_name(typed)))
            }
            Beyond::Map(typed, ..) => Ok(match self.library.around(self.instance, &controls.beyond)? {
                Around::Map(map, ..) => {
                    let (width, height) = map.image().size();
                    format!("{about} Beyond the plate: {}, {width} x {height}.", file_name(typed))
                }
                Around::Stretch | Around::Colour(_) => about,
            }),
        }
    }

    fn forget(&self, effect: &Effect<'_>, time: f64) {
        self.library.forget(self.instance, &Controls::read(effect, time));
    }
}

impl Voice<'_> {
    fn about(&self, controls: &Controls) -> Result<String> {
        let field = self.library.field(self.instance, &controls.asset)?;
        let form = match field.choose(controls.look.representation)? {
            Kind::Dense => String::new(),
            kind => format!(", {}", kind.id()),
        };
        let (asset, plane) = (field.asset(), field.plane());
        let (name, width, height) = (file_name(&controls.asset), asset.width(), asset.height());
        let (columns, rows) = plane.size();
        Ok(format!("{name}: {width} x {height} pixels, a screen of {columns} x {rows} texels{form}."))
    }
}
