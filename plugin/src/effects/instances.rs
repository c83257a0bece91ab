//! Instances of an effect, by the host's handle. Not in the host's own instance data: a render can still run while a careless
//! host destroys the instance, and then holds its share of it.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::host::Call;

/// Instances, each with what it owns.
#[derive(Debug)]
pub struct Instances<I>(Mutex<HashMap<usize, Arc<I>>>);

impl<I> Default for Instances<I> {
    fn default() -> Self {
        Self(Mutex::default())
    }
}

impl<I: Default> Instances<I> {
    fn all(&self) -> MutexGuard<'_, HashMap<usize, Arc<I>>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The instance of a call; one that was never announced gets a passing one.
    pub fn of(&self, call: &Call<'_>) -> Arc<I> {
        self.all().get(&call.effect.key()).cloned().unwrap_or_default()
    }

    /// A new one.
    pub fn create(&self, call: &Call<'_>) -> Arc<I> {
        let instance = Arc::<I>::default();
        let before = self.all().insert(call.effect.key(), Arc::clone(&instance));
        drop(before);
        instance
    }

    /// Lets go of one; what it owned is closed outside of the lock.
    pub fn destroy(&self, call: &Call<'_>) {
        let gone = self.all().remove(&call.effect.key());
        drop(gone);
    }

    /// Lets go of all.
    pub fn clear(&self) {
        let gone = std::mem::take(&mut *self.all());
        drop(gone);
    }
}
