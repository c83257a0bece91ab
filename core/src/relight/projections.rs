//! Lights projected onto the lamps, with what does not change between frames kept.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::Weights;
use crate::domain::Directions;
use crate::error::{Error, Result};
use crate::illumination::{Beam, EnvMap};
use crate::reconstruct::{Method, Operator, Outside, Reconstruction};

/// Operators kept. A user switches between two methods and two maps.
const KEPT_OPERATORS: usize = 4;
/// Reconstructions kept: some megabytes each.
const KEPT_RECONSTRUCTIONS: usize = 4;

/// What an operator depends on, beside the lamps.
type Key = (Method, Outside, usize, usize);

/// The lamps that answer for light, and the reconstructions over them. All methods take `&self`.
#[derive(Debug)]
pub(super) struct Projections {
    /// The lamps in use.
    domain: Arc<Directions>,
    /// Their numbers among all lamps, from 0, ascending; `None` for all of them.
    used: Option<Vec<u32>>,
    /// How many lamps there are in all.
    lamps: usize,
    reconstructions: Mutex<Kept<Method, Reconstruction>>,
    operators: Mutex<Kept<Key, Operator>>,
}

impl Projections {
    /// Over all lamps of a set.
    pub fn new(domain: Arc<Directions>) -> Self {
        let lamps = domain.len();
        Self { domain, used: None, lamps, reconstructions: Mutex::default(), operators: Mutex::default() }
    }

    /// Without some lamps (numbers from 1), whose place the others take.
    ///
    /// # Errors
    /// A number that no lamp has; no lamp left.
    pub fn without(domain: &Directions, excluded: &[usize]) -> Result<Self> {
        let lamps = domain.len();
        if let Some(number) = excluded.iter().find(|n| !(1..=lamps).contains(n)) {
            return Err(Error::invalid("lamps to leave out", format!("lamp {number}"), format!("1 to {lamps}")));
        }
        let used: Vec<u32> = (0..lamps as u32).filter(|&n| !excluded.contains(&(n as usize + 1))).collect();
        if used.is_empty() {
            return Err(Error::invalid("lamps to leave out", "all of them", "at least one lamp left"));
        }
        let directions = used.iter().map(|&n| domain.lamps()[n as usize]).collect();
        let left = Directions::with_coverage(directions, domain.axis(), domain.coverage())?;
        Ok(Self { used: Some(used), lamps, ..Self::new(Arc::new(left)) })
    }

    /// Is any lamp left out?
    pub fn leaves_out(&self) -> bool {
        self.used.is_some()
    }

    /// `integral of U_j(w) L(w) dw` for a map in the stage frame.
    ///
    /// # Errors
    /// As [`Reconstruction::new`].
    pub fn map(&self, map: &EnvMap, method: Method, outside: Outside) -> Result<Weights> {
        let (w, h) = map.image().size();
        Ok(self.weights(self.operator((method, outside, w, h))?.downsample(map)))
    }

    /// The same for beams.
    ///
    /// # Errors
    /// As [`Reconstruction::new`].
    pub fn beams(&self, beams: &[Beam], method: Method, outside: Outside) -> Result<Weights> {
        Ok(self.weights(self.reconstruction(method)?.project(beams, outside)))
    }

    /// Lamps that are not in use get nothing.
    fn weights(&self, rgb: Vec<[f32; 3]>) -> Weights {
        let Some(used) = &self.used else { return Weights::of_lamps(rgb) };
        let mut weights = Weights::dark(self.lamps);
        used.iter().zip(rgb).for_each(|(&n, rgb)| weights.rgb[n as usize] = rgb);
        weights
    }

    /// The reconstruction of a method, built on first use.
    fn reconstruction(&self, method: Method) -> Result<Arc<Reconstruction>> {
        kept(&self.reconstructions, method, KEPT_RECONSTRUCTIONS, || Reconstruction::new(self.domain.clone(), method))
    }

    /// The projection for a key, built on first use.
    fn operator(&self, key: Key) -> Result<Arc<Operator>> {
        let (method, outside, w, h) = key;
        let build = || Ok(Operator::new(self.reconstruction(method)?, outside, w, h));
        kept(&self.operators, key, KEPT_OPERATORS, build)
    }
}

/// Most recently used first.
pub(super) type Kept<K, V> = Vec<(K, Arc<V>)>;

/// The value of a key among those used most recently, built where it is not kept. Two threads that miss at once both build it; the result is the same.
pub(super) fn kept<K: PartialEq, V>(
    list: &Mutex<Kept<K, V>>,
    key: K,
    most: usize,
    build: impl FnOnce() -> Result<V>,
) -> Result<Arc<V>> {
    // A poisoned lock only means that another thread panicked between two harmless steps.
    let lock = || -> MutexGuard<'_, Kept<K, V>> { list.lock().unwrap_or_else(PoisonError::into_inner) };
    let take = |kept: &mut Kept<K, V>| {
        let at = kept.iter().position(|entry| entry.0 == key)?;
        kept[..=at].rotate_right(1);
        Some(kept[0].1.clone())
    };
    if let Some(found) = take(&mut lock()) {
        return Ok(found);
    }
    let built = Arc::new(build()?);
    let mut kept = lock();
    kept.insert(0, (key, built.clone()));
    kept.truncate(most);
    Ok(built)
}
