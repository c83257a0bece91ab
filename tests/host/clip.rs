//! Clips: what they are fed, and the images they hand out.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, Weak};

use super::effect::{Effect, Spent};
use super::image::TestImage;
use super::log::Rule;
use super::ofx::*;
use super::pixels::{Buffer, Rect};
use super::props::{Prop, PropertySet, Row};
use super::registry::{Object, register};
use super::render::Job;
use super::schema::row;
use super::shared::{Shared, lock};

/// A picture for each time.
pub type Frames = Arc<dyn Fn(f64) -> Option<TestImage> + Send + Sync>;

/// What a clip is connected to.
#[derive(Clone, Default)]
pub enum Feed {
    /// Nothing.
    #[default]
    Nothing,
    /// The same picture at all times.
    Image(Arc<TestImage>),
    /// A picture for each time; none where the function returns `None`.
    Frames(Frames),
    /// Said to be connected, but getting an image fails.
    NoImage,
    /// Said to be connected; getting an image is OK and gives NULL.
    NullImage,
    /// Said to be connected; the image has no pixels (Data is NULL).
    NoData,
}

/// A clip, described or of an instance.
pub struct Clip {
    pub name: String,
    pub props: Arc<PropertySet>,
    pub effect: Weak<Effect>,
    pub feed: Mutex<Feed>,
    handle: Mutex<usize>,
}

impl Clip {
    /// A new clip with handles.
    pub fn new(shared: &Arc<Shared>, effect: &Arc<Effect>, name: &str, rows: Vec<Row>) -> Arc<Self> {
        let clip = Arc::new(Self {
            name: name.into(),
            props: PropertySet::new(shared, format!("clip {name}"), rows),
            effect: Arc::downgrade(effect),
            feed: Mutex::default(),
            handle: Mutex::default(),
        });
        *lock(&clip.handle) = register(shared, Object::Clip(Arc::clone(&clip)));
        clip
    }

    /// The handle to give to plugins.
    pub fn handle(&self) -> OfxImageClipHandle {
        *lock(&self.handle) as OfxImageClipHandle
    }

    /// Takes the handles back.
    pub fn close(&self) {
        self.props.close();
        super::registry::retire(*lock(&self.handle));
    }

    /// Whether this is the output.
    pub fn is_output(&self) -> bool {
        self.name.as_bytes() == kOfxImageEffectOutputClipName.to_bytes()
    }

    /// The picture at a time, at full size.
    pub fn picture(&self, time: f64) -> Option<Arc<TestImage>> {
        match &*lock(&self.feed) {
            Feed::Image(image) => Some(Arc::clone(image)),
            Feed::Frames(frames) => frames(time).map(Arc::new),
            _ => None,
        }
    }

    /// Connects something, and tells the plugin's properties.
    pub fn connect(&self, feed: Feed) {
        let connected = !matches!(feed, Feed::Nothing);
        self.props.put(kOfxImageClipPropConnected, Prop::ints(&[i32::from(connected)]));
        let first = self.props.numbers(kOfxImageEffectPropFrameRange).first().copied().unwrap_or(0.0);
        *lock(&self.feed) = feed;
        if let Some(image) = self.picture(first) {
            for name in [kOfxImageEffectPropPixelDepth, kOfxImageClipPropUnmappedPixelDepth] {
                self.props.put(name, Prop::text(image.depth.name()));
            }
            for name in [kOfxImageEffectPropComponents, kOfxImageClipPropUnmappedComponents] {
                self.props.put(name, Prop::text(image.components.name()));
            }
        }
    }
}

/// An image in the plugin's hands.
pub struct Image {
    pub clip: String,
    pub props: Arc<PropertySet>,
    pub buffer: Arc<Buffer>,
    /// The bytes an input was handed out with.
    original: Option<Vec<u8>>,
    pub job: Option<Arc<Job>>,
    pub effect: Weak<Effect>,
    is_output: bool,
    handle: AtomicUsize,
}

static COUNT: AtomicUsize = AtomicUsize::new(1);

impl Image {
    /// The image handle, which is that of its properties too.
    pub fn handle(&self) -> usize {
        self.handle.load(Ordering::Relaxed)
    }

    /// Hands out the output of a render.
    pub fn output(effect: &Arc<Effect>, clip: &Clip, job: &Arc<Job>) -> OfxPropertySetHandle {
        check_released(&effect.shared, job);
        let rows = rows(clip, &job.buffer, job.buffer.layout.bounds, job.scale, true);
        Self::hand_out(effect, clip, rows, Arc::clone(&job.buffer), None, Some(Arc::clone(job)))
    }

    /// Hands out an input.
    pub fn input(
        effect: &Arc<Effect>,
        clip: &Clip,
        image: &TestImage,
        job: Option<Arc<Job>>,
        data: bool,
    ) -> OfxPropertySetHandle {
        let scale = job.as_ref().map_or((1.0, 1.0), |job| job.scale);
        let scaled = image.scaled(scale);
        let buffer = Arc::new(scaled.buffer());
        let rows = rows(clip, &buffer, scaled.bounds(), scale, data);
        let original = buffer.snapshot();
        Self::hand_out(effect, clip, rows, buffer, Some(original), job)
    }

    fn hand_out(
        effect: &Arc<Effect>,
        clip: &Clip,
        rows: Vec<Row>,
        buffer: Arc<Buffer>,
        original: Option<Vec<u8>>,
        job: Option<Arc<Job>>,
    ) -> OfxPropertySetHandle {
        let image = Arc::new(Self {
            clip: clip.name.clone(),
            props: PropertySet::bare(&effect.shared, format!("image of {}", clip.name), rows),
            buffer,
            is_output: original.is_none(),
            original,
            job,
            effect: Arc::downgrade(effect),
            handle: AtomicUsize::new(0),
        });
        let handle = register(&effect.shared, Object::Image(Arc::clone(&image)));
        image.handle.store(handle, Ordering::Relaxed);
        handle as OfxPropertySetHandle
    }

    /// What happens to the pixels when the plugin releases the image: an input must be as it was, and is poisoned;
    /// the output must stay as it is from now on.
    pub fn released(&self) {
        let Some(effect) = self.effect.upgrade() else { return };
        let now = self.buffer.snapshot();
        if self.is_output {
            if let Some(job) = &self.job {
                *lock(&job.released) = Some(now);
            }
            return;
        }
        if self.original.as_ref().is_some_and(|original| *original != now) {
            effect.shared.violate(Rule::InputWritten, format!("the image of {} was written to", self.clip));
        }
        self.buffer.poison();
        let bytes = self.buffer.snapshot();
        lock(&effect.spent).push(Spent { clip: self.clip.clone(), buffer: Arc::clone(&self.buffer), bytes });
    }
}

/// Finds writes to an output between its release and now.
pub fn check_released(shared: &Shared, job: &Job) {
    if lock(&job.released).take().is_some_and(|bytes| bytes != job.buffer.snapshot()) {
        shared.violate(Rule::AfterRelease, "the output was written after its release");
    }
}

fn rows(clip: &Clip, buffer: &Buffer, defined: Rect, (sx, sy): (f64, f64), data: bool) -> Vec<Row> {
    let layout = &buffer.layout;
    let unique = format!("{}-{}", clip.name, COUNT.fetch_add(1, Ordering::Relaxed));
    let alpha = clip.props.text(kOfxImageEffectPropPreMultiplication);
    let aspect = clip.props.numbers(kOfxImagePropPixelAspectRatio).first().copied().unwrap_or(1.0);
    vec![
        row(kOfxPropType, Prop::text(kOfxTypeImage)),
        row(kOfxImageEffectPropPixelDepth, Prop::text(layout.depth.name())),
        row(kOfxImageEffectPropComponents, Prop::text(layout.components.name())),
        row(kOfxImageEffectPropPreMultiplication, Prop::texts(&[alpha])),
        row(kOfxImageEffectPropRenderScale, Prop::doubles(&[sx, sy])),
        row(kOfxImagePropPixelAspectRatio, Prop::doubles(&[aspect])),
        row(kOfxImagePropData, Prop::pointer(if data { buffer.data() } else { 0 })),
        row(kOfxImagePropBounds, Prop::ints(&layout.bounds.edges())),
        row(kOfxImagePropRegionOfDefinition, Prop::ints(&defined.edges())),
        row(kOfxImagePropRowBytes, Prop::ints(&[buffer.row_bytes()])),
        row(kOfxImagePropField, Prop::text(kOfxImageFieldBoth)),
        row(kOfxImagePropUniqueIdentifier, Prop::texts(&[unique])),
    ]
}
