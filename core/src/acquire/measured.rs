//! What was measured of the lamps one by one: irradiances, and how light falls off over the object.

use std::path::{Path, PathBuf};

use crate::calibrate::lamp_table::{self, Row};
use crate::calibrate::near::{Plane, even_out, flat_field};
use crate::error::{Error, Result};
use crate::image::{Encoding, Image, probe_size, read};
use crate::math::Vec3;

/// How near lamps are evened out.
#[derive(Debug, Clone, Default, PartialEq)]
pub enum FlatField {
    /// Lamps are far away.
    #[default]
    None,
    /// A folder with a photograph of a flat white card under every lamp, named as the lamp's photograph of the object.
    Cards(PathBuf),
    /// From the lamps' places in the table, by the law of the inverse square and the cosine on the plane z = 0.
    Places {
        /// Size of a pixel on the object.
        metres_per_pixel: f64,
    },
}

/// What an import knows of its lamps beyond their directions.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Measured {
    /// A table of irradiances and places ([`lamp_table`]).
    pub lamps: Option<PathBuf>,
    /// How near lamps are evened out.
    pub flat_field: FlatField,
    /// The pixel that shows the stage's origin, to which irradiances refer; by default the middle of the picture.
    pub origin_px: Option<[f64; 2]>,
}

/// [`Measured`], read and checked against the photographs.
#[derive(Debug, Clone)]
pub(super) struct PerLamp {
    rows: Option<Vec<Row>>,
    cards: Option<Vec<PathBuf>>,
    plane: Option<Plane>,
    origin_px: [f64; 2],
}

impl Measured {
    /// The cards, in the order of the photographs; none without a folder of them.
    pub fn cards(&self, photographs: &[PathBuf]) -> Option<Vec<PathBuf>> {
        let FlatField::Cards(folder) = &self.flat_field else { return None };
        Some(photographs.iter().map(|path| folder.join(path.file_name().unwrap_or_default())).collect())
    }

    /// Reads the table, and looks at the headers of the cards.
    pub(super) fn check(&self, photographs: &[PathBuf], size: (usize, usize)) -> Result<PerLamp> {
        let rows = self.lamps.as_deref().map(|path| lamp_table::read(path, photographs)).transpose()?;
        let cards = self.cards(photographs);
        for card in cards.iter().flatten() {
            let found = probe_size(card)?;
            if found != size {
                let place = card.display().to_string();
                let expected = format!("{} x {} pixels, as the photographs have", size.0, size.1);
                return Err(Error::invalid(place, format!("{} x {} pixels", found.0, found.1), expected));
            }
        }
        let origin_px = self.origin_px.unwrap_or([0.5 * size.0 as f64, 0.5 * size.1 as f64]);
        let plane = match self.flat_field {
            FlatField::Places { metres_per_pixel } => {
                self.check_places(rows.as_deref())?;
                Some(Plane { metres_per_pixel, origin_px })
            }
            _ => None,
        };
        Ok(PerLamp { rows, cards, plane, origin_px })
    }

    fn check_places(&self, rows: Option<&[Row]>) -> Result<()> {
        let expected = "a table of lamps with the place of every lamp in metres";
        let (Some(rows), Some(path)) = (rows, &self.lamps) else {
            return Err(Error::invalid("flat field", "no places of the lamps", expected));
        };
        let lost = rows.iter().find(|row| row.position_m.is_none());
        lost.map_or(Ok(()), |row| {
            let found = format!("no place of the lamp of `{}`", row.photograph);
            Err(Error::invalid(path.display().to_string(), found, expected))
        })
    }
}

impl PerLamp {
    /// The irradiance of each lamp; `usual` without a table.
    pub fn irradiances(&self, lamps: usize, usual: f32) -> Vec<f32> {
        match &self.rows {
            Some(rows) => rows.iter().map(|row| row.irradiance as f32).collect(),
            None => vec![usual; lamps],
        }
    }

    /// Evens out the photograph of lamp `n` (the black photograph taken off already).
    pub fn even_out(&self, n: usize, photograph: &mut Image, encoding: Encoding, black: Option<&Image>) -> Result<()> {
        let (w, h) = photograph.size();
        if let Some(cards) = &self.cards {
            let card = read(&cards[n], encoding)?;
            even_out(photograph, &flat_field(&card, black, self.origin_px, &cards[n].display().to_string())?);
        }
        if let (Some(plane), Some(lamp)) = (&self.plane, self.place(n)) {
            even_out(photograph, &plane.falloff(lamp, w, h, &format!("lamp {}", n + 1))?);
        }
        Ok(())
    }

    fn place(&self, n: usize) -> Option<&Vec3> {
        self.rows.as_ref()?[n].position_m.as_ref()
    }

    /// What to remember in the file.
    pub fn provenance(&self, table: Option<&Path>) -> serde_json::Value {
        let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let flat = match (&self.cards, &self.plane) {
            (Some(_), _) => Some("cards".to_owned()),
            (None, Some(plane)) => Some(format!("places, {} m a pixel", plane.metres_per_pixel)),
            (None, None) => None,
        };
        serde_json::json!({ "lamps": table.map(name), "flat_field": flat })
    }
}
