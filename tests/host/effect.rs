//! An effect as the plugin's handles see it: a descriptor, or an instance with its parameters and clips.

use std::sync::{Arc, Mutex, Weak};

use super::clip::{Clip, Image};
use super::log::Rule;
use super::ofx::*;
use super::param::Param;
use super::pixels::Buffer;
use super::props::{Prop, PropertySet, Row, Type};
use super::registry::{Object, alive, register, retire};
use super::render::Job;
use super::schema::row;
use super::shared::{Shared, lock};

/// What an effect handle is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// The action Describe.
    Descriptor,
    /// The action DescribeInContext.
    InContext,
    /// An instance.
    Instance,
}

/// An input image after its release.
pub struct Spent {
    pub clip: String,
    pub buffer: Arc<Buffer>,
    /// Its bytes when it was released.
    pub bytes: Vec<u8>,
}

/// An effect.
pub struct Effect {
    pub shared: Arc<Shared>,
    pub role: Role,
    pub props: Arc<PropertySet>,
    pub param_props: Arc<PropertySet>,
    pub params: Mutex<Vec<Arc<Param>>>,
    pub clips: Mutex<Vec<Arc<Clip>>>,
    /// Renders under way.
    pub jobs: Mutex<Vec<Arc<Job>>>,
    /// Inputs released while renders are under way.
    pub spent: Mutex<Vec<Spent>>,
    handles: Mutex<(usize, usize)>,
}

impl Effect {
    /// A new effect with handles, without parameters and clips.
    pub fn new(shared: &Arc<Shared>, role: Role, rows: Vec<Row>) -> Arc<Self> {
        let param_rows = vec![
            row(kOfxPluginPropParamPageOrder, Prop::list(Type::Text)),
            row(kOfxPropParamSetNeedsSyncing, Prop::ints(&[0]).writable()),
        ];
        let effect = Arc::new(Self {
            shared: Arc::clone(shared),
            role,
            props: PropertySet::new(shared, format!("effect {role:?}"), rows),
            param_props: PropertySet::new(shared, "parameter set", param_rows),
            params: Mutex::default(),
            clips: Mutex::default(),
            jobs: Mutex::default(),
            spent: Mutex::default(),
            handles: Mutex::default(),
        });
        let handle = register(shared, Object::Effect(Arc::clone(&effect)));
        *lock(&effect.handles) = (handle, register(shared, Object::Params(Arc::clone(&effect))));
        effect
    }

    /// The handle of the effect.
    pub fn handle(&self) -> OfxImageEffectHandle {
        lock(&self.handles).0 as OfxImageEffectHandle
    }

    /// The handle of its parameter set.
    pub fn params_handle(&self) -> OfxParamSetHandle {
        lock(&self.handles).1 as OfxParamSetHandle
    }

    /// A parameter by name.
    pub fn param(&self, name: &str) -> Option<Arc<Param>> {
        lock(&self.params).iter().find(|param| param.name == name).cloned()
    }

    /// A clip by name.
    pub fn clip(&self, name: &str) -> Option<Arc<Clip>> {
        lock(&self.clips).iter().find(|clip| clip.name == name).cloned()
    }

    /// The render that a call on this thread belongs to: that of the thread, else (the plugin's own threads) one of
    /// the same time.
    pub fn job(&self, time: f64) -> Option<Arc<Job>> {
        let own = super::shared::with_current(|scope| scope.job.clone()).flatten();
        own.or_else(|| lock(&self.jobs).iter().find(|job| job.time == time).cloned())
    }

    /// Finds released inputs that were written to since, and forgets them.
    pub fn check_spent(&self) {
        for spent in lock(&self.spent).drain(..) {
            if spent.buffer.snapshot() != spent.bytes {
                self.shared
                    .violate(Rule::AfterRelease, format!("an image of {} was written after its release", spent.clip));
            }
        }
    }

    fn is_mine(&self, effect: &Weak<Self>) -> bool {
        std::ptr::eq(effect.as_ptr(), self)
    }

    /// The images of this effect that the plugin holds (of one render, if given).
    pub fn held_images(&self, job: Option<&Arc<Job>>) -> Vec<(usize, Arc<Image>)> {
        let same = |image: &Image| match (job, &image.job) {
            (Some(job), Some(of)) => Arc::ptr_eq(job, of),
            (None, _) => true,
            _ => false,
        };
        let images = alive(&self.shared, |object| match object {
            Object::Image(image) if self.is_mine(&image.effect) && same(image) => Some(Arc::clone(image)),
            _ => None,
        });
        images.into_iter().map(|image| (image.handle(), image)).collect()
    }

    /// Reports and takes back images that were not released.
    pub fn report_held(&self, job: Option<&Arc<Job>>) {
        for (handle, image) in self.held_images(job) {
            self.shared.violate(Rule::LeakedImage, format!("an image of {} was not released", image.clip));
            retire(handle);
        }
    }

    /// Takes all handles back and reports what the plugin still held.
    pub fn close(&self) {
        self.report_held(None);
        self.check_spent();
        let blocks = alive(&self.shared, |object| match object {
            Object::Memory(memory) if self.is_mine(&memory.effect) => Some(memory.block.len() * 8),
            _ => None,
        });
        for size in blocks {
            self.shared.violate(Rule::LeakedMemory, format!("image memory of {size} bytes was not freed"));
        }
        lock(&self.params).drain(..).for_each(|param| param.close());
        lock(&self.clips).drain(..).for_each(|clip| clip.close());
        self.props.close();
        self.param_props.close();
        let (effect, params) = *lock(&self.handles);
        retire(effect);
        retire(params);
    }
}
