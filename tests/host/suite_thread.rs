//! The multithread suite, version 1.

use std::cell::Cell;
use std::ffi::{c_int, c_uint, c_void};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread::{self, ThreadId};

use super::log::Rule;
use super::ofx::*;
use super::registry::{Object, find, register, retire};
use super::shared::{blame, in_scope, lock, with_current};
use super::suite_effect::answer;

/// The suite.
pub static SUITE: OfxMultiThreadSuiteV1 = OfxMultiThreadSuiteV1 {
    multiThread: Some(multi_thread),
    multiThreadNumCPUs: Some(num_cpus),
    multiThreadIndex: Some(index),
    multiThreadIsSpawnedThread: Some(is_spawned),
    mutexCreate: Some(mutex_create),
    mutexDestroy: Some(mutex_destroy),
    mutexLock: Some(mutex_lock),
    mutexUnLock: Some(mutex_unlock),
    mutexTryLock: Some(mutex_try_lock),
};

thread_local! {
    static INDEX: Cell<Option<u32>> = const { Cell::new(None) };
}

/// A recursive mutex, as the standard has it.
#[derive(Default)]
pub struct HostMutex {
    owner: Mutex<(Option<ThreadId>, i32)>,
    freed: Condvar,
}

impl HostMutex {
    fn lock(&self, wait: bool) -> bool {
        let me = thread::current().id();
        let mut owner = lock(&self.owner);
        while owner.0.is_some_and(|other| other != me) {
            if !wait {
                return false;
            }
            owner = self.freed.wait(owner).unwrap_or_else(PoisonError::into_inner);
        }
        *owner = (Some(me), owner.1 + 1);
        true
    }

    fn unlock(&self) -> bool {
        let mut owner = lock(&self.owner);
        if owner.0 != Some(thread::current().id()) {
            return false;
        }
        owner.1 -= 1;
        if owner.1 == 0 {
            owner.0 = None;
            self.freed.notify_one();
        }
        true
    }
}

/// A pointer that goes to the plugin's threads.
#[derive(Clone, Copy)]
struct Argument(*mut c_void);
// SAFETY: the plugin gives it to be used on several threads: that is what the function is for.
unsafe impl Send for Argument {}
// SAFETY: as above.
unsafe impl Sync for Argument {}

unsafe extern "C" fn multi_thread(function: OfxThreadFunctionV1, threads: c_uint, argument: *mut c_void) -> OfxStatus {
    let Some(function) = function else {
        blame(Rule::NullPointer, "multiThread was given no function");
        return kOfxStatFailed;
    };
    if INDEX.get().is_some() {
        return kOfxStatErrExists;
    }
    let (argument, count) = (Argument(argument), if threads == 0 { cpus() } else { threads });
    let scope = with_current(Clone::clone);
    let real = scope.as_ref().is_none_or(|scope| scope.shared.options.real_threads);
    let run = |at: u32| {
        let whole = argument;
        INDEX.set(Some(at));
        // SAFETY: the plugin's function with the argument it gave, as the standard says.
        let call = || unsafe { function(at, count, whole.0) };
        match scope.clone() {
            Some(scope) => in_scope(scope, call),
            None => call(),
        }
        INDEX.set(None);
    };
    if real {
        thread::scope(|scope| (0..count).for_each(|at| drop(scope.spawn(move || run(at)))));
    } else {
        (0..count).for_each(run);
    }
    kOfxStatOK
}

fn cpus() -> u32 {
    thread::available_parallelism().map_or(1, |count| u32::try_from(count.get()).unwrap_or(1))
}

unsafe extern "C" fn num_cpus(out: *mut c_uint) -> OfxStatus {
    // SAFETY: the plugin's variable, as the standard demands.
    unsafe { answer("multiThreadNumCPUs", out, Ok(cpus())) }
}

unsafe extern "C" fn index(out: *mut c_uint) -> OfxStatus {
    // SAFETY: the plugin's variable, as the standard demands.
    unsafe { answer("multiThreadIndex", out, INDEX.get().ok_or(kOfxStatFailed)) }
}

unsafe extern "C" fn is_spawned() -> c_int {
    c_int::from(INDEX.get().is_some())
}

fn mutex_of(handle: OfxMutexHandle, call: &str) -> Result<Arc<HostMutex>, OfxStatus> {
    find(handle, call, "mutex", |object| match object {
        Object::Mutex(mutex) => Some(Arc::clone(mutex)),
        _ => None,
    })
}

unsafe extern "C" fn mutex_create(out: *mut OfxMutexHandle, locks: c_int) -> OfxStatus {
    let found = with_current(|scope| Arc::clone(&scope.shared)).ok_or(kOfxStatFailed).map(|shared| {
        let mutex = Arc::new(HostMutex::default());
        (0..locks).for_each(|_| assert!(mutex.lock(true), "a mutex nobody else has"));
        register(&shared, Object::Mutex(mutex)) as OfxMutexHandle
    });
    // SAFETY: the plugin's variable, as the standard demands.
    unsafe { answer("mutexCreate", out, found) }
}

unsafe extern "C" fn mutex_destroy(handle: OfxMutexHandle) -> OfxStatus {
    match mutex_of(handle, "mutexDestroy") {
        Ok(mutex) => {
            if lock(&mutex.owner).0.is_some() {
                blame(Rule::LeakedMutex, "a mutex was destroyed while locked");
            }
            retire(handle as usize);
            kOfxStatOK
        }
        Err(status) => status,
    }
}

unsafe extern "C" fn mutex_lock(handle: OfxMutexHandle) -> OfxStatus {
    mutex_of(handle, "mutexLock").map_or_else(
        |status| status,
        |mutex| {
            mutex.lock(true);
            kOfxStatOK
        },
    )
}

unsafe extern "C" fn mutex_unlock(handle: OfxMutexHandle) -> OfxStatus {
    match mutex_of(handle, "mutexUnLock") {
        Ok(mutex) if mutex.unlock() => kOfxStatOK,
        Ok(_) => {
            blame(Rule::Unbalanced, "a mutex was unlocked by a thread that had not locked it");
            kOfxStatFailed
        }
        Err(status) => status,
    }
}

unsafe extern "C" fn mutex_try_lock(handle: OfxMutexHandle) -> OfxStatus {
    match mutex_of(handle, "mutexTryLock") {
        Ok(mutex) if mutex.lock(false) => kOfxStatOK,
        Ok(_) => kOfxStatFailed,
        Err(status) => status,
    }
}
