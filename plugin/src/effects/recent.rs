//! What is made once a picture and kept for its tiles: hosts ask for a picture tile by tile, and for a few pictures at once.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::error::Result;

/// The latest values of a kind, each with what it was made from.
#[derive(Debug)]
pub struct Recent<K, V, const KEPT: usize> {
    /// Latest first.
    entries: Mutex<VecDeque<(K, Arc<V>)>>,
    /// Held while a value is made: threads that render tiles of one picture would all make it.
    making: Mutex<()>,
}

impl<K, V, const KEPT: usize> Default for Recent<K, V, KEPT> {
    fn default() -> Self {
        Self { entries: Mutex::default(), making: Mutex::default() }
    }
}

impl<K, V, const KEPT: usize> Recent<K, V, KEPT> {
    /// The value whose key `fits`, or the one that `make` makes for `key`.
    ///
    /// # Errors
    /// Whatever `make` meets; the next caller tries again.
    pub fn get(
        &self,
        fits: impl Fn(&K) -> bool,
        key: impl FnOnce() -> K,
        make: impl FnOnce() -> Result<V>,
    ) -> Result<Arc<V>> {
        let find = || self.entries().iter().find(|(key, _)| fits(key)).map(|(_, value)| Arc::clone(value));
        if let Some(value) = find() {
            return Ok(value);
        }
        let _making = self.making.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(value) = find() {
            return Ok(value);
        }
        let value = Arc::new(make()?);
        let mut entries = self.entries();
        entries.push_front((key(), Arc::clone(&value)));
        let end = entries.len().min(KEPT);
        let dropped = entries.split_off(end);
        drop(entries);
        drop(dropped);
        Ok(value)
    }

    /// Lets go of all.
    pub fn clear(&self) {
        let dropped = std::mem::take(&mut *self.entries());
        drop(dropped);
    }

    fn entries(&self) -> MutexGuard<'_, VecDeque<(K, Arc<V>)>> {
        self.entries.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicUsize, Ordering};

    #[test]
    fn a_value_is_made_once_and_the_oldest_goes() {
        let (recent, made) = (Recent::<u32, u32, 2>::default(), AtomicUsize::new(0));
        let ask = |n: u32| {
            let make = || {
                made.fetch_add(1, Ordering::SeqCst);
                Ok(n * 10)
            };
            *recent.get(|key| *key == n, || n, make).unwrap()
        };
        std::thread::scope(|scope| {
            (0..8).for_each(|_| drop(scope.spawn(|| assert_eq!(ask(1), 10))));
        });
        assert_eq!(made.load(Ordering::SeqCst), 1);
        assert_eq!([ask(2), ask(1), ask(3), ask(2)], [20, 10, 30, 20]);
        assert_eq!(made.load(Ordering::SeqCst), 3);
        ask(1);
        assert_eq!(made.load(Ordering::SeqCst), 4, "the first had gone");
        let failing = recent.get(|key| *key == 9, || 9, || Err(crate::error::Error::Missing("no")));
        assert!(failing.is_err());
        assert_eq!(ask(9), 90);
        recent.clear();
        assert!(recent.entries().is_empty());
    }
}
