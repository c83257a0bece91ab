//! Our threads. They start with the first picture and have ended when Unload returns.
//!
//! A host unmaps the library after Unload, so a thread that still runs our code then would crash the host. Dropping a
//! rayon pool only *asks* its threads to end; here each is joined as well. For the same reason rayon's global pool,
//! which never ends, must not be woken: everything that may use rayon runs inside [`Pool::run`].
//!
//! Never take a lock inside [`Pool::run`]: a thread that waits for its share of work may run another picture's work
//! meanwhile, and would wait for itself.

use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;

use crate::error::Result;

static POOL: Mutex<Option<Arc<Pool>>> = Mutex::new(None);

/// A rayon pool whose threads have ended when it is dropped.
pub struct Pool {
    /// `None` only while dropping.
    workers: Option<rayon::ThreadPool>,
    threads: Vec<JoinHandle<()>>,
}

impl Pool {
    /// Starts one thread a core (or `RAYON_NUM_THREADS`).
    ///
    /// # Errors
    /// The system gives no thread; those already started have ended.
    pub fn new() -> Result<Self> {
        let mut threads = Vec::new();
        let workers = rayon::ThreadPoolBuilder::new()
            .spawn_handler(|worker| {
                let name = format!("relume-{}", worker.index());
                threads.push(std::thread::Builder::new().name(name).spawn(|| worker.run())?);
                Ok(())
            })
            .build();
        match workers {
            Ok(workers) => Ok(Self { workers: Some(workers), threads }),
            Err(error) => {
                join(threads);
                Err(error.into())
            }
        }
    }

    /// The pool that all instances share.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn shared() -> Result<Arc<Self>> {
        let mut pool = POOL.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(pool) = pool.as_ref() {
            return Ok(Arc::clone(pool));
        }
        let started = Arc::new(Self::new()?);
        *pool = Some(Arc::clone(&started));
        Ok(started)
    }

    /// Ends the shared pool, and its threads unless a picture is still being made (which a host must not allow); then
    /// they end with that picture.
    pub fn shut_down() {
        let pool = POOL.lock().unwrap_or_else(PoisonError::into_inner).take();
        drop(pool);
    }

    /// Runs work on the threads and waits for it.
    pub fn run<R: Send>(&self, work: impl FnOnce() -> R + Send) -> R {
        match &self.workers {
            Some(workers) => workers.install(work),
            None => work(),
        }
    }
}

impl Drop for Pool {
    fn drop(&mut self) {
        drop(self.workers.take());
        join(std::mem::take(&mut self.threads));
    }
}

fn join(threads: Vec<JoinHandle<()>>) {
    for thread in threads {
        // A thread that panicked has ended too, which is all that counts here.
        let _ = thread.join();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rayon::prelude::*;
    use std::sync::atomic::{AtomicUsize, Ordering};

    /// Counts itself down when its thread ends.
    struct Alive;
    static ALIVE: AtomicUsize = AtomicUsize::new(0);
    impl Drop for Alive {
        fn drop(&mut self) {
            // Slow enough that a pool which does not wait is caught.
            std::thread::sleep(std::time::Duration::from_millis(50));
            ALIVE.fetch_sub(1, Ordering::SeqCst);
        }
    }
    thread_local! {
        static MARK: Alive = { ALIVE.fetch_add(1, Ordering::SeqCst); Alive };
    }

    #[test]
    fn no_thread_outlives_the_pool() {
        for _ in 0..3 {
            let pool = Pool::new().unwrap();
            let sum: u64 = pool.run(|| {
                (0..10_000u64)
                    .into_par_iter()
                    .map(|i| {
                        MARK.with(|_| ());
                        i
                    })
                    .sum()
            });
            assert_eq!(sum, 49_995_000);
            assert!(ALIVE.load(Ordering::SeqCst) > 0);
            drop(pool);
            assert_eq!(ALIVE.load(Ordering::SeqCst), 0, "a thread was still ending");
        }
    }

    #[test]
    fn the_shared_pool_starts_again_after_its_end() {
        let first = Pool::shared().unwrap();
        assert!(Arc::ptr_eq(&first, &Pool::shared().unwrap()));
        Pool::shut_down();
        assert_eq!(first.run(|| 1), 1, "whoever holds it can finish");
        assert!(!Arc::ptr_eq(&first, &Pool::shared().unwrap()));
        Pool::shut_down();
    }
}
