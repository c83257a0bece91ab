//! The host and its suites. Mandatory ones are needed for anything to work; optional ones are `Option`s.

use std::ffi::CStr;
use std::sync::atomic::{AtomicPtr, Ordering};
use std::sync::{Arc, PoisonError, RwLock};

use openfx::sys::generic::core::{OfxHost, kOfxPropName};
use openfx::sys::generic::property::{OfxPropertySuiteV1, kOfxPropertySuite};
use openfx::sys::image_effect_v1::image_effect::{OfxImageEffectSuiteV1, kOfxImageEffectSuite};
use openfx::sys::image_effect_v1::message::{OfxMessageSuiteV1, OfxMessageSuiteV2, kOfxMessageSuite};
use openfx::sys::image_effect_v1::param::{OfxParameterSuiteV1, kOfxParameterSuite};

use super::Properties;

/// A host that ends the whole process when asked for version 2 of a suite (openfx-runner calls itself so).
const NO_VERSION_TWO: &str = "openfx-driver";

static HOST: AtomicPtr<OfxHost> = AtomicPtr::new(std::ptr::null_mut());
static SUITES: RwLock<Option<Arc<Suites>>> = RwLock::new(None);

/// Copies of the tables of functions that the host offers.
#[derive(Debug)]
pub struct Suites {
    pub(super) property: OfxPropertySuiteV1,
    pub(super) effect: OfxImageEffectSuiteV1,
    pub(super) parameter: OfxParameterSuiteV1,
    pub(super) message: Option<OfxMessageSuiteV1>,
    pub(super) persistent: Option<OfxMessageSuiteV2>,
}

/// Remembers the host. Hosts call this before Load, some more than once.
pub fn set_host(host: *mut OfxHost) {
    if HOST.swap(host, Ordering::AcqRel) != host {
        forget_suites();
    }
}

/// Drops the tables: after Unload they may be gone.
pub fn forget_suites() {
    *SUITES.write().unwrap_or_else(PoisonError::into_inner) = None;
}

impl Suites {
    /// The tables, fetched on first use. `None` when there is no host or a mandatory suite is missing.
    pub fn get() -> Option<Arc<Self>> {
        if let Some(suites) = SUITES.read().unwrap_or_else(PoisonError::into_inner).as_ref() {
            return Some(Arc::clone(suites));
        }
        let suites = Arc::new(Self::fetch()?);
        *SUITES.write().unwrap_or_else(PoisonError::into_inner) = Some(Arc::clone(&suites));
        Some(suites)
    }

    fn fetch() -> Option<Self> {
        let pointer = HOST.load(Ordering::Acquire);
        // SAFETY: the host keeps its struct alive from setHost until the library is unloaded, as the standard demands;
        // null is answered by `None`. The struct is copied at once.
        let host = *unsafe { pointer.as_ref() }?;
        let mut suites = Self {
            property: suite(&host, kOfxPropertySuite, 1)?,
            effect: suite(&host, kOfxImageEffectSuite, 1)?,
            parameter: suite(&host, kOfxParameterSuite, 1)?,
            message: suite(&host, kOfxMessageSuite, 1),
            persistent: None,
        };
        let name = Properties::new(&suites, host.host).and_then(|p| p.string(kOfxPropName, 0));
        if name.as_deref() != Some(NO_VERSION_TWO) {
            suites.persistent = suite(&host, kOfxMessageSuite, 2);
        }
        Some(suites)
    }
}

/// Fetches one table. `T` must be the struct that the standard lays down for this name and version.
fn suite<T: Copy>(host: &OfxHost, name: &CStr, version: i32) -> Option<T> {
    let fetch = host.fetchSuite?;
    // SAFETY: the arguments are the host's own handle and a NUL-terminated name; a host without the suite answers NULL.
    let table = unsafe { fetch(host.host, name.as_ptr(), version) };
    // SAFETY: every call in this file pairs a name and version with its struct from the binding, and the host's table
    // lives at least until Unload; it is copied here.
    unsafe { table.cast::<T>().as_ref() }.copied()
}
