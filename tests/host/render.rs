//! Rendering: the buffer with its canaries, the actions, and what is found wrong afterwards.

use std::sync::{Arc, Mutex};

use super::clip::check_released;
use super::image::{TestImage, scale_rect};
use super::instance::Instance;
use super::log::{Rule, Violation};
use super::ofx::*;
use super::pixels::{Buffer, Components, Depth, Layout, Rect};
use super::props::{Prop, Row};
use super::schema::row;
use super::shared::lock;

/// What to render, and into what kind of memory.
#[derive(Debug, Clone, PartialEq)]
pub struct RenderArgs {
    /// The frame.
    pub time: f64,
    /// The pixels asked for (at the render scale, y up); all of the bounds by default.
    pub window: Option<Rect>,
    /// The pixels that the output image has; the region of definition by default.
    pub bounds: Option<Rect>,
    /// The render scale.
    pub scale: (f64, f64),
    /// Depth of the output.
    pub depth: Depth,
    /// Components of the output.
    pub components: Components,
    /// Bytes after each row.
    pub row_padding: usize,
    /// The top row first in memory.
    pub negative_rows: bool,
    /// The user is waiting.
    pub interactive: bool,
}

impl Default for RenderArgs {
    fn default() -> Self {
        Self {
            time: 1.0,
            window: None,
            bounds: None,
            scale: (1.0, 1.0),
            depth: Depth::Float,
            components: Components::Rgba,
            row_padding: 0,
            negative_rows: false,
            interactive: false,
        }
    }
}

/// A render under way.
pub struct Job {
    pub time: f64,
    pub scale: (f64, f64),
    pub buffer: Arc<Buffer>,
    /// The bytes when the plugin released the output.
    pub released: Mutex<Option<Vec<u8>>>,
}

/// What came of a render.
#[derive(Debug, Clone)]
pub struct Rendered {
    /// The status of the action Render.
    pub status: i32,
    /// The window, as linear RGBA, top-down. Pixels that the plugin left alone hold rubbish.
    pub image: TestImage,
    /// Pixels of the window that the plugin left alone.
    pub untouched: usize,
    /// What went wrong meanwhile (on this host: renders at the same time see each other's).
    pub violations: Vec<Violation>,
}

impl Rendered {
    /// Whether it answered OK.
    pub fn ok(&self) -> bool {
        self.status == kOfxStatOK
    }

    /// Whether it answered Failed.
    pub fn failed(&self) -> bool {
        self.status == kOfxStatFailed
    }

    /// The picture of a render that answered OK.
    ///
    /// # Panics
    /// When it did not.
    pub fn unwrap(self) -> TestImage {
        assert!(self.ok(), "render answered {}: {:?}", status_name(self.status), self.violations);
        self.image
    }
}

impl Instance {
    pub(super) fn identity_arguments(&self, args: &RenderArgs) -> Vec<Row> {
        let (_, window) = self.extents(args);
        window_rows(args, window)
    }

    /// The bounds of the output and the window.
    fn extents(&self, args: &RenderArgs) -> (Rect, Rect) {
        let (sx, sy) = args.scale;
        let aspect = self.core.shared.options.pixel_aspect;
        let bounds = args.bounds.unwrap_or_else(|| scale_rect(self.region_of_definition(args.time), (sx / aspect, sy)));
        let window = args.window.unwrap_or(bounds);
        assert_eq!(window.intersect(&bounds), window, "the window lies inside the bounds");
        (bounds, window)
    }

    /// Renders, between the actions that begin and end a sequence. May be called from several threads at once.
    pub fn render(&self, args: &RenderArgs) -> Rendered {
        let shared = &self.core.shared;
        let (bounds, window) = self.extents(args);
        let (depth, components) = (args.depth, args.components);
        let (padding, negative_rows) = (args.row_padding, args.negative_rows);
        let buffer = Arc::new(Buffer::new(Layout { bounds, depth, components, padding, negative_rows }));
        if let Some(output) = self.effect.clip("Output") {
            output.props.put(kOfxImageEffectPropPixelDepth, Prop::text(depth.name()));
            output.props.put(kOfxImageEffectPropComponents, Prop::text(components.name()));
        }
        let job = Arc::new(Job { time: args.time, scale: args.scale, buffer, released: Mutex::default() });
        let (violations, messages) = shared.marks();

        self.sequence(kOfxImageEffectActionBeginSequenceRender, args);
        lock(&self.effect.jobs).push(Arc::clone(&job));
        let inputs = self.core.args("arguments of Render", render_rows(args, window));
        let action = kOfxImageEffectActionRender;
        let status = self.core.act(action, self.effect.handle(), (Some(&inputs), None), Some(Arc::clone(&job)));
        inputs.close();
        let idle = {
            let mut jobs = lock(&self.effect.jobs);
            jobs.retain(|other| !Arc::ptr_eq(other, &job));
            jobs.is_empty()
        };
        self.effect.report_held(Some(&job));
        if idle {
            self.effect.check_spent();
        }
        self.sequence(kOfxImageEffectActionEndSequenceRender, args);

        let failures = [kOfxStatFailed, kOfxStatErrMemory, kOfxStatErrFormat, kOfxStatErrImageFormat, kOfxStatErrFatal];
        self.core.expect(action, status, &[&[kOfxStatOK][..], &failures].concat());
        if status == kOfxStatFailed && !shared.aborted() && self.silent(messages) {
            shared.violate(Rule::NoMessage, "Render failed, and the user was not told why");
        }
        let untouched = self.inspect(&job, window, status);
        let violations = lock(&shared.log).get(violations..).map(<[_]>::to_vec).unwrap_or_default();
        Rendered { status, image: job.buffer.picture(window), untouched, violations }
    }

    /// No message since, and none that stays, though there is a suite for it.
    fn silent(&self, messages: usize) -> bool {
        let dumb = self.core.shared.options.missing_suites.contains(&kOfxMessageSuite);
        !dumb && self.messages().len() <= messages && self.persistent_message().is_none()
    }

    /// Looks at the canaries. Returns the pixels left alone.
    fn inspect(&self, job: &Job, window: Rect, status: OfxStatus) -> usize {
        let shared = &self.core.shared;
        check_released(shared, job);
        let damage = job.buffer.damage(window);
        if let Some((count, (x, y))) = damage.outside {
            let what = format!("{count} pixels outside {window:?} were written, the first at ({x}, {y})");
            shared.violate(Rule::OutsideWindow, what);
        }
        if damage.padding > 0 {
            shared.violate(Rule::Padding, format!("the padding of {} rows was written", damage.padding));
        }
        if damage.overrun {
            shared.violate(Rule::Overrun, "bytes before or after the image were written");
        }
        if damage.unwritten > 0 && status == kOfxStatOK {
            shared.violate(Rule::Unwritten, format!("{} pixels of {window:?} were not written", damage.unwritten));
        }
        damage.unwritten
    }

    fn sequence(&self, action: &std::ffi::CStr, args: &RenderArgs) {
        let mut rows = vec![
            row(kOfxImageEffectPropFrameRange, Prop::doubles(&[args.time, args.time])),
            row(kOfxImageEffectPropFrameStep, Prop::doubles(&[1.0])),
            row(kOfxPropIsInteractive, Prop::ints(&[args.interactive.into()])),
        ];
        rows.extend(common_rows(args));
        let inputs = self.core.args(&format!("arguments of {}", name(action)), rows);
        let status = self.core.act(action, self.effect.handle(), (Some(&inputs), None), None);
        inputs.close();
        self.core.expect(action, status, &[kOfxStatOK, kOfxStatReplyDefault]);
    }

    /// Renders tile by tile and puts the tiles together; the output image has all bounds each time.
    ///
    /// # Panics
    /// When a tile does not answer OK.
    pub fn render_tiles(&self, args: &RenderArgs, size: i32) -> TestImage {
        let (bounds, window) = self.extents(args);
        let mut whole = TestImage::new(window.width(), window.height()).at(window.x1, window.y1);
        for tile in window.tiles(size) {
            let args = RenderArgs { window: Some(tile), bounds: Some(bounds), ..args.clone() };
            whole.paste(&self.render(&args).unwrap());
        }
        whole
    }

    /// Renders several frames from as many threads as given, each thread taking every n-th; the results are in order.
    pub fn render_from_threads(&self, frames: &[RenderArgs], threads: usize) -> Vec<Rendered> {
        from_threads(frames, threads, |args| self.render(args))
    }
}

/// Runs `work` on all arguments from several threads; the results are in the order of the arguments.
///
/// # Panics
/// When `work` does.
pub fn from_threads<A: Sync, T: Send>(arguments: &[A], threads: usize, work: impl Fn(&A) -> T + Sync) -> Vec<T> {
    let next = std::sync::atomic::AtomicUsize::new(0);
    let done = Mutex::new(Vec::new());
    std::thread::scope(|scope| {
        for _ in 0..threads.max(1) {
            scope.spawn(|| {
                while let Some((at, argument)) = {
                    let at = next.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
                    arguments.get(at).map(|argument| (at, argument))
                } {
                    let result = work(argument);
                    lock(&done).push((at, result));
                }
            });
        }
    });
    let mut done = std::mem::take(&mut *lock(&done));
    done.sort_by_key(|(at, _)| *at);
    done.into_iter().map(|(_, result)| result).collect()
}

fn common_rows(args: &RenderArgs) -> Vec<Row> {
    vec![
        row(kOfxImageEffectPropRenderScale, Prop::doubles(&[args.scale.0, args.scale.1])),
        row(kOfxImageEffectPropSequentialRenderStatus, Prop::ints(&[0])),
        row(kOfxImageEffectPropInteractiveRenderStatus, Prop::ints(&[args.interactive.into()])),
    ]
}

fn window_rows(args: &RenderArgs, window: Rect) -> Vec<Row> {
    vec![
        row(kOfxPropTime, Prop::doubles(&[args.time])),
        row(kOfxImageEffectPropFieldToRender, Prop::text(kOfxImageFieldNone)),
        row(kOfxImageEffectPropRenderWindow, Prop::ints(&window.edges())),
        row(kOfxImageEffectPropRenderScale, Prop::doubles(&[args.scale.0, args.scale.1])),
    ]
}

fn render_rows(args: &RenderArgs, window: Rect) -> Vec<Row> {
    let mut rows = window_rows(args, window);
    rows.extend(common_rows(args));
    rows.push(row(kOfxImageEffectPropRenderQualityDraft, Prop::ints(&[0])));
    rows
}
