//! Handles. A handle is a number, never an address: looking it up finds the object, or says that it was released (and
//! against which host that counts), or that it never was one. A plugin that follows a handle as a pointer faults.

use std::collections::HashMap;
use std::sync::atomic::AtomicU64;
use std::sync::{Arc, RwLock, Weak};

use super::clip::{Clip, Image};
use super::effect::Effect;
use super::log::Rule;
use super::ofx::{OfxStatus, kOfxStatErrBadHandle};
use super::param::Param;
use super::props::PropertySet;
use super::shared::{Shared, blame};
use super::suite_thread::HostMutex;

/// What a handle stands for.
#[derive(Clone)]
pub enum Object {
    Props(Arc<PropertySet>),
    Effect(Arc<Effect>),
    Params(Arc<Effect>),
    Param(Arc<Param>),
    Clip(Arc<Clip>),
    /// An image; its handle is at the same time that of its property set.
    Image(Arc<Image>),
    Memory(Arc<ImageMemory>),
    Mutex(Arc<HostMutex>),
}

/// A block of the image effect suite.
pub struct ImageMemory {
    /// Atomic, for plugins write to it behind the host's back.
    pub block: Box<[AtomicU64]>,
    pub effect: Weak<Effect>,
}

impl Object {
    fn kind(&self) -> &'static str {
        match self {
            Self::Props(_) => "property set",
            Self::Effect(_) => "effect",
            Self::Params(_) => "parameter set",
            Self::Param(_) => "parameter",
            Self::Clip(_) => "clip",
            Self::Image(_) => "image",
            Self::Memory(_) => "image memory",
            Self::Mutex(_) => "mutex",
        }
    }
}

#[derive(Default)]
struct Registry {
    live: HashMap<usize, (Object, Weak<Shared>)>,
    dead: HashMap<usize, (&'static str, Weak<Shared>)>,
    next: usize,
}

static REGISTRY: RwLock<Option<Registry>> = RwLock::new(None);

/// Not a canonical address on any 64-bit machine, so that following a handle faults at once.
const TAG: usize = 0x0fce << (usize::BITS - 16);

fn with_registry<T>(work: impl FnOnce(&mut Registry) -> T) -> T {
    let mut guard = REGISTRY.write().unwrap_or_else(std::sync::PoisonError::into_inner);
    work(guard.get_or_insert_default())
}

/// Gives an object a handle.
pub fn register(shared: &Arc<Shared>, object: Object) -> usize {
    with_registry(|registry| {
        registry.next += 1;
        let handle = TAG | (registry.next << 4);
        registry.live.insert(handle, (object, Arc::downgrade(shared)));
        handle
    })
}

/// Takes a handle back; using it from now on is a [`Rule::StaleHandle`].
pub fn retire(handle: usize) -> Option<Object> {
    with_registry(|registry| {
        let (object, shared) = registry.live.remove(&handle)?;
        registry.dead.insert(handle, (object.kind(), shared));
        Some(object)
    })
}

fn look(handle: usize) -> Option<Object> {
    let guard = REGISTRY.read().unwrap_or_else(std::sync::PoisonError::into_inner);
    guard.as_ref()?.live.get(&handle).map(|(object, _)| object.clone())
}

/// The objects of one host that are alive and pass `pick`.
pub fn alive<T>(shared: &Arc<Shared>, pick: impl Fn(&Object) -> Option<T>) -> Vec<T> {
    with_registry(|registry| {
        let mine = |owner: &Weak<Shared>| std::ptr::eq(owner.as_ptr(), Arc::as_ptr(shared));
        registry.live.values().filter(|(_, owner)| mine(owner)).filter_map(|(object, _)| pick(object)).collect()
    })
}

/// Finds what a handle given to suite function `call` stands for.
///
/// # Errors
/// `kOfxStatErrBadHandle`, and the violation is recorded.
pub fn find<H, T>(
    handle: *mut H,
    call: &str,
    wanted: &str,
    pick: impl Fn(&Object) -> Option<T>,
) -> Result<T, OfxStatus> {
    let number = handle as usize;
    if number == 0 {
        blame(Rule::NullHandle, format!("{call} was given NULL for its {wanted}"));
        return Err(kOfxStatErrBadHandle);
    }
    if let Some(object) = look(number) {
        return pick(&object).ok_or_else(|| {
            blame(Rule::BadHandle, format!("{call} was given a {} for its {wanted}", object.kind()));
            kOfxStatErrBadHandle
        });
    }
    match with_registry(|registry| registry.dead.get(&number).cloned()) {
        Some((kind, shared)) => match shared.upgrade() {
            Some(shared) => shared.violate(Rule::StaleHandle, format!("{call} was given a released {kind}")),
            None => blame(Rule::StaleHandle, format!("{call} was given a {kind} of a host that is gone")),
        },
        None => blame(Rule::BadHandle, format!("{call} was given {number:#x}, which is no {wanted}")),
    }
    Err(kOfxStatErrBadHandle)
}
