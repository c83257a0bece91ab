//! Which kind of elements a rig has.

use std::sync::Arc;

use super::{Correspondence, Directions, Plane};

/// What a rig could emit: the elements of `L`, one kind of them.
#[derive(Debug, Clone)]
pub enum Domain {
    /// Lamps at infinity.
    Directions(Arc<Directions>),
    /// The texels of a screen, and where on it each pixel of the camera looks, if that is known.
    Plane(Plane, Option<Box<Correspondence>>),
}

impl Domain {
    /// How many elements.
    #[allow(clippy::len_without_is_empty, reason = "never empty")]
    pub fn len(&self) -> usize {
        match self {
            Self::Directions(lamps) => lamps.len(),
            Self::Plane(plane, _) => plane.len(),
        }
    }

    /// The lamps, of a rig that has some.
    pub fn directions(&self) -> Option<&Arc<Directions>> {
        match self {
            Self::Directions(lamps) => Some(lamps),
            Self::Plane(..) => None,
        }
    }

    /// The texels, of a rig with a screen.
    pub fn plane(&self) -> Option<&Plane> {
        match self {
            Self::Plane(plane, _) => Some(plane),
            Self::Directions(_) => None,
        }
    }

    /// Where on the screen each pixel of the camera looks, of a rig with a screen that was looked at.
    pub fn correspondence(&self) -> Option<&Correspondence> {
        match self {
            Self::Plane(_, correspondence) => correspondence.as_deref(),
            Self::Directions(_) => None,
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
