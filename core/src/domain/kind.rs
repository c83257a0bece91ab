//! Which kind of elements a rig has.

use std::sync::Arc;

use super::{Correspondence, Directions, Gantry, Plane};

/// What a rig could emit: the elements of `L`, one kind of them.
#[derive(Debug, Clone)]
pub enum Domain {
    /// Lamps at infinity.
    Directions(Arc<Directions>),
    /// The texels of a screen, and where on it each pixel of the camera looks, if that is known.
    Plane(Plane, Option<Box<Correspondence>>),
    /// The squares of a projector at many positions.
    Gantry(Arc<Gantry>),
}

impl Domain {
    /// How many elements.
    #[allow(clippy::len_without_is_empty, reason = "never empty")]
    pub fn len(&self) -> usize {
        match self {
            Self::Directions(lamps) => lamps.len(),
            Self::Plane(plane, _) => plane.len(),
            Self::Gantry(gantry) => gantry.len(),
        }
    }

    /// What people call an element, in the plural.
    pub fn elements(&self) -> &'static str {
        match self {
            Self::Directions(_) => "lamps",
            Self::Plane(..) => "texels",
            Self::Gantry(_) => "squares",
        }
    }

    /// The lamps, of a rig that has some.
    pub fn directions(&self) -> Option<&Arc<Directions>> {
        match self {
            Self::Directions(lamps) => Some(lamps),
            Self::Plane(..) | Self::Gantry(_) => None,
        }
    }

    /// The texels, of a rig with a screen.
    pub fn plane(&self) -> Option<&Plane> {
        match self {
            Self::Plane(plane, _) => Some(plane),
            Self::Directions(_) | Self::Gantry(_) => None,
        }
    }

    /// The grid of one picture that a screen or projector shows.
    pub fn picture(&self) -> Option<Plane> {
        match self {
            Self::Directions(_) => None,
            Self::Plane(plane, _) => Some(*plane),
            Self::Gantry(gantry) => Some(gantry.picture()),
        }
    }

    /// Where on the screen each pixel of the camera looks, of a rig with a screen that was looked at.
    pub fn correspondence(&self) -> Option<&Correspondence> {
        match self {
            Self::Plane(_, correspondence) => correspondence.as_deref(),
            Self::Directions(_) | Self::Gantry(_) => None,
        }
    }

    /// The positions and squares, of a rig with a projector.
    pub fn gantry(&self) -> Option<&Arc<Gantry>> {
        match self {
            Self::Gantry(gantry) => Some(gantry),
            Self::Directions(_) | Self::Plane(..) => None,
        }
    }
}

impl From<Directions> for Domain {
    fn from(lamps: Directions) -> Self {
        Self::Directions(Arc::new(lamps))
    }
}

impl From<Arc<Directions>> for Domain {
    fn from(lamps: Arc<Directions>) -> Self {
        Self::Directions(lamps)
    }
}

impl From<Gantry> for Domain {
    fn from(gantry: Gantry) -> Self {
        Self::Gantry(Arc::new(gantry))
    }
}
