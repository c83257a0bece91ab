//! Our own OpenFX host, for tests. It loads a bundle (or takes a plugin from memory), plays every part of a host that
//! hosts play differently (depths, strides, origins, tiles, missing clips, scales, threads), and is strict: whatever
//! breaks the standard is written down as a [`Violation`], and a host dropped with violations fails the test.
//!
//! A call runs like this: [`Instance`] (`instance`, `render`) makes the arguments and calls the plugin's main entry
//! through [`Plugin`] (`plugin`); the plugin calls back into the suites (`suite_*`, `variadic`), which find the objects
//! behind its handles (`registry`: `effect`, `param`, `clip`, `props`), and those record what is wrong (`log`, `shared`).
//! `schema` has the property tables of the standard, `check` what must be there after describing, `pixels` the canaries.
//!
//! ```no_run
//! use relume_tests::host::{Context, Host, Options, RenderArgs, TestImage};
//! let host = Host::new(Options::default());
//! let plugin = host.load(&relume_tests::bundle()).unwrap();
//! let instance = plugin.create(Context::Filter).unwrap();
//! instance.set_string("asset", "bunny.rfield");
//! instance.clip("Source").connect(TestImage::new(64, 48));
//! let rendered = instance.render(&RenderArgs { time: 3.0, ..RenderArgs::default() });
//! assert!(rendered.ok());
//! ```

mod binary;
mod check;
mod clip;
mod effect;
mod image;
mod instance;
mod log;
mod ofx;
mod options;
mod param;
mod pixels;
mod plugin;
mod props;
mod registry;
mod render;
mod schema;
mod shared;
mod suite_effect;
mod suite_param;
mod suite_property;
mod suite_small;
mod suite_thread;
mod variadic;

pub use image::TestImage;
pub use instance::{ClipInput, ClipPreferences, Instance};
pub use log::{Message, Rule, Violation};
pub use options::Options;
pub use pixels::{Components, Depth, Rect};
pub use plugin::{Context, Description, Plugin};
pub use render::{RenderArgs, Rendered, from_threads};
pub use variadic::SUPPORTED as VARIADICS_SUPPORTED;

use std::ffi::{c_char, c_int, c_void};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::Ordering;

use ofx::*;
use props::PropertySet;
use registry::{Object, find};
use shared::{Shared, lock};

/// A host. Dropping it with violations on record fails the test, unless they were taken.
pub struct Host {
    shared: Arc<Shared>,
    props: Arc<PropertySet>,
    ofx: &'static OfxHost,
}

impl Host {
    /// A host with these options.
    pub fn new(options: Options) -> Self {
        let rows = schema::host(&options);
        let shared = Shared::new(options);
        let props = PropertySet::new(&shared, "host", rows);
        // Leaked on purpose: a plugin may hold the pointer for as long as its library is mapped.
        let ofx = Box::leak(Box::new(OfxHost { host: props.handle(), fetchSuite: Some(fetch_suite) }));
        Self { shared, props, ofx }
    }

    /// Opens a private copy of a bundle (so that tests side by side do not share its state) and loads its first effect.
    ///
    /// # Errors
    /// A sentence about what is missing or failed.
    pub fn load(&self, bundle: &Path) -> Result<Plugin, String> {
        let (copy, folder) = binary::private_copy(bundle)?;
        self.open(&copy, None, Some(folder))
    }

    /// As [`Self::load`], for the effect of that identifier.
    ///
    /// # Errors
    /// A sentence about what is missing or failed.
    pub fn load_effect(&self, bundle: &Path, identifier: &str) -> Result<Plugin, String> {
        let (copy, folder) = binary::private_copy(bundle)?;
        self.open(&copy, Some(identifier), Some(folder))
    }

    /// As [`Self::load_effect`], for several effects of one copy, which share its library.
    ///
    /// # Errors
    /// A sentence about what is missing or failed.
    pub fn load_effects<const N: usize>(&self, bundle: &Path, identifiers: [&str; N]) -> Result<[Plugin; N], String> {
        let (copy, folder) = binary::private_copy(bundle)?;
        let mut folder = Some(folder);
        let plugins: Result<Vec<_>, _> =
            identifiers.iter().map(|identifier| self.open(&copy, Some(identifier), folder.take())).collect();
        plugins?.try_into().map_err(|_| "as many plugins as identifiers".to_owned())
    }

    /// The identifiers of all effects of a bundle, in its order.
    ///
    /// # Errors
    /// A sentence about what is missing.
    pub fn identifiers(&self, bundle: &Path) -> Result<Vec<String>, String> {
        binary::identifiers(&self.shared, bundle)
    }

    /// Opens the bundle where it is: the library is shared with everyone in this process who does the same.
    ///
    /// # Errors
    /// A sentence about what is missing or failed.
    pub fn load_in_place(&self, bundle: &Path) -> Result<Plugin, String> {
        self.open(bundle, None, None)
    }

    fn open(&self, bundle: &Path, id: Option<&str>, folder: Option<tempfile::TempDir>) -> Result<Plugin, String> {
        let opened = binary::open(&self.shared, bundle, id, self.ofx)?;
        Plugin::start(&self.shared, self.ofx, opened.plugin, bundle, Some((opened.library, folder)))
    }

    /// Takes a plugin from memory.
    ///
    /// # Errors
    /// A sentence about what failed.
    pub fn adopt(&self, plugin: &'static OfxPlugin) -> Result<Plugin, String> {
        Plugin::start(&self.shared, self.ofx, plugin, Path::new("/in/memory"), None)
    }

    /// All messages so far.
    pub fn messages(&self) -> Vec<Message> {
        lock(&self.shared.messages).clone()
    }

    /// All violations so far.
    pub fn violations(&self) -> Vec<Violation> {
        lock(&self.shared.log).clone()
    }

    /// The violations so far, leaks of memory included; they no longer fail the test.
    pub fn take_violations(&self) -> Vec<Violation> {
        self.report_leaks();
        std::mem::take(&mut *lock(&self.shared.log))
    }

    /// Puts the timeline at a time, where paramGetValue reads.
    pub fn seek(&self, time: f64) {
        *lock(&self.shared.timeline) = time;
    }

    /// Whether the user wants renders to stop.
    pub fn set_abort(&self, abort: bool) {
        self.shared.abort.store(abort, Ordering::Relaxed);
    }

    /// Reports what plugins hold of the host: to be called when none is loaded.
    fn report_leaks(&self) {
        for (_, size) in lock(&self.shared.memory).drain() {
            self.shared.violate(Rule::LeakedMemory, format!("a block of {size} bytes was not freed"));
        }
        let mutexes = registry::alive(&self.shared, |object| match object {
            Object::Mutex(mutex) => Some(Arc::clone(mutex)),
            _ => None,
        });
        for _ in mutexes {
            self.shared.violate(Rule::LeakedMutex, "a mutex was not destroyed");
        }
    }
}

impl Drop for Host {
    fn drop(&mut self) {
        self.report_leaks();
        self.props.close();
        let violations = self.violations();
        if self.shared.options.fail_on_drop && !violations.is_empty() && !std::thread::panicking() {
            let lines: Vec<_> = violations.iter().map(|violation| format!("  {violation}")).collect();
            panic!("the plugin broke {} rules:\n{}", lines.len(), lines.join("\n"));
        }
    }
}

fn as_suite<T>(suite: &'static T) -> *const c_void {
    std::ptr::from_ref(suite).cast()
}

unsafe extern "C" fn fetch_suite(host: OfxPropertySetHandle, suite: *const c_char, version: c_int) -> *const c_void {
    let found = find(host, "fetchSuite", "host", |object| match object {
        Object::Props(props) => props.owner(),
        _ => None,
    });
    // SAFETY: the plugin passes a NUL-terminated name, as the standard demands.
    let (Ok(shared), Some(wanted)) = (found, unsafe { text(suite) }) else { return std::ptr::null() };
    let options = &shared.options;
    if options.missing_suites.iter().any(|missing| name(missing) == wanted) {
        return std::ptr::null();
    }
    match (wanted.as_str(), version) {
        ("OfxPropertySuite", 1) => as_suite(&suite_property::SUITE),
        ("OfxParameterSuite", 1) => as_suite(&suite_param::SUITE),
        ("OfxImageEffectSuite", 1) => as_suite(&suite_effect::SUITE),
        ("OfxMemorySuite", 1) => as_suite(&suite_small::MEMORY),
        ("OfxMultiThreadSuite", 1) => as_suite(&suite_thread::SUITE),
        ("OfxMessageSuite", 1) => as_suite(&suite_small::MESSAGE),
        ("OfxMessageSuite", 2) if options.persistent_messages => as_suite(&suite_small::MESSAGE_V2),
        ("OfxProgressSuite", 1) => as_suite(&suite_small::PROGRESS),
        ("OfxTimeLineSuite", 1) => as_suite(&suite_small::TIMELINE),
        _ => std::ptr::null(),
    }
}
