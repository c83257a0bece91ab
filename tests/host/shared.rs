//! What all objects of one host share: options, the log, the messages; and which host, action and time a thread is in.

use std::cell::RefCell;
use std::collections::{BTreeMap, HashMap};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};

use super::log::{Message, Rule, Violation};
use super::options::Options;
use super::render::Job;

/// The state of one host.
pub struct Shared {
    pub options: Options,
    pub log: Mutex<Vec<Violation>>,
    pub messages: Mutex<Vec<Message>>,
    /// Blocks of the memory suite: address -> size.
    pub memory: Mutex<HashMap<usize, usize>>,
    /// Persistent messages by effect handle.
    pub persistent: Mutex<BTreeMap<usize, Message>>,
    pub timeline: Mutex<f64>,
    pub abort: AtomicBool,
    pub progress: Mutex<HashMap<usize, usize>>,
}

/// Locks, even after a panic in another test thread: the data are plain values.
pub fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Shared {
    /// A new host state, known to [`blame`].
    pub fn new(options: Options) -> Arc<Self> {
        let timeline = Mutex::new(options.frame_range.0);
        let shared = Arc::new(Self {
            options,
            timeline,
            log: Mutex::default(),
            messages: Mutex::default(),
            memory: Mutex::default(),
            persistent: Mutex::default(),
            abort: AtomicBool::new(false),
            progress: Mutex::default(),
        });
        let mut hosts = lock(&HOSTS);
        hosts.retain(|host| host.strong_count() > 0);
        hosts.push(Arc::downgrade(&shared));
        shared
    }

    /// Records a violation.
    pub fn violate(&self, rule: Rule, what: impl Into<String>) {
        let action = with_current(|scope| scope.action.clone()).unwrap_or_default();
        lock(&self.log).push(Violation { rule, action, what: what.into() });
    }

    /// How many violations and messages there are now.
    pub fn marks(&self) -> (usize, usize) {
        (lock(&self.log).len(), lock(&self.messages).len())
    }

    /// Whether the user asked to stop.
    pub fn aborted(&self) -> bool {
        self.abort.load(Ordering::Relaxed)
    }
}

/// What a thread is doing inside the host's call into the plugin.
#[derive(Clone)]
pub struct Scope {
    pub shared: Arc<Shared>,
    pub action: String,
    pub job: Option<Arc<Job>>,
}

static HOSTS: Mutex<Vec<Weak<Shared>>> = Mutex::new(Vec::new());

thread_local! {
    static SCOPES: RefCell<Vec<Scope>> = const { RefCell::new(Vec::new()) };
}

/// Runs `body` with this thread marked as being in an action.
pub fn in_scope<T>(scope: Scope, body: impl FnOnce() -> T) -> T {
    struct Leave;
    impl Drop for Leave {
        fn drop(&mut self) {
            SCOPES.with_borrow_mut(Vec::pop);
        }
    }
    SCOPES.with_borrow_mut(|scopes| scopes.push(scope));
    let _leave = Leave;
    body()
}

/// The innermost action of this thread.
pub fn with_current<T>(read: impl FnOnce(&Scope) -> T) -> Option<T> {
    SCOPES.with_borrow(|scopes| scopes.last().map(read))
}

/// Records a violation that no handle ties to a host: against the host whose action this thread is in, else (a thread
/// of the plugin's own) against every live host, since one of them it must be.
pub fn blame(rule: Rule, what: impl Into<String>) {
    let what = what.into();
    if let Some(shared) = with_current(|scope| Arc::clone(&scope.shared)) {
        return shared.violate(rule, what);
    }
    hosts().iter().for_each(|host| host.violate(rule, what.clone()));
}

/// The hosts that live.
pub fn hosts() -> Vec<Arc<Shared>> {
    lock(&HOSTS).iter().filter_map(Weak::upgrade).collect()
}
