//! The test host tested: a good plugin in memory passes, and each of its bad brothers, which break one rule, is caught.

use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::ptr::{null, null_mut};
use std::sync::atomic::{AtomicPtr, Ordering};

use openfx::sys::generic::core::*;
use openfx::sys::generic::property::*;
use openfx::sys::image_effect_v1::image_effect::*;
use openfx::sys::image_effect_v1::memory::*;
use openfx::sys::image_effect_v1::message::*;
use openfx::sys::image_effect_v1::multi_thread::*;
use openfx::sys::image_effect_v1::param::*;
use relume_tests::host::*;

/// What a plugin does wrong.
type Fault = u8;
const GOOD: Fault = 0;
const LEAKS_IMAGE: Fault = 1;
const WRITES_OUTSIDE: Fault = 2;
const WRONG_TYPE: Fault = 3;
const NO_LABEL: Fault = 4;
const DEFAULT_FOR_LOAD: Fault = 5;
const WRITES_PADDING: Fault = 6;
const NULL_HANDLE: Fault = 7;
const STALE_IMAGE: Fault = 8;
const UNKNOWN_PARAM: Fault = 9;
const UNKNOWN_CLIP: Fault = 10;
const UNKNOWN_PROPERTY: Fault = 11;
const WRONG_DIMENSION: Fault = 12;
const LEAKS_MEMORY: Fault = 13;
const LEAKS_IMAGE_MEMORY: Fault = 14;
const WRITES_AFTER_RELEASE: Fault = 15;
const WRITES_INPUT: Fault = 16;
const LEAVES_PIXELS: Fault = 17;
const SILENT_FAILURE: Fault = 18;
const SETS_IN_RENDER: Fault = 19;
const NO_SOURCE: Fault = 20;
const NO_COMPONENTS: Fault = 21;
const BAD_DEFAULT: Fault = 22;
const NO_DEPTHS: Fault = 23;
const LEAKS_MUTEX: Fault = 24;
const UNKNOWN_DEPTH: Fault = 25;
const OVERRUNS: Fault = 26;
const DEFAULT_FOR_DESTROY: Fault = 27;
const READ_ONLY: Fault = 28;
const FAULTS: usize = 29;

static HOSTS: [AtomicPtr<OfxHost>; FAULTS] = [const { AtomicPtr::new(null_mut()) }; FAULTS];

unsafe extern "C" fn set_host<const FAULT: Fault>(host: *mut OfxHost) {
    HOSTS[usize::from(FAULT)].store(host, Ordering::SeqCst);
}

/// A suite of the host.
fn suite<T>(fault: Fault, name: &CStr, version: c_int) -> Option<&'static T> {
    let host = HOSTS[usize::from(fault)].load(Ordering::SeqCst);
    // SAFETY: the host gave the pointer for good, and suites are static.
    unsafe { (*host).fetchSuite.and_then(|fetch| fetch((*host).host, name.as_ptr(), version).cast::<T>().as_ref()) }
}

/// The suites at hand.
struct Suites {
    fault: Fault,
    props: &'static OfxPropertySuiteV1,
    effect: &'static OfxImageEffectSuiteV1,
    params: &'static OfxParameterSuiteV1,
}

impl Suites {
    fn new(fault: Fault) -> Self {
        let missing = "mandatory suites";
        Self {
            fault,
            props: suite(fault, kOfxPropertySuite, 1).expect(missing),
            effect: suite(fault, kOfxImageEffectSuite, 1).expect(missing),
            params: suite(fault, kOfxParameterSuite, 1).expect(missing),
        }
    }

    fn is(&self, fault: Fault) -> bool {
        self.fault == fault
    }

    fn text(&self, set: OfxPropertySetHandle, name: &CStr, index: c_int, value: &CStr) -> OfxStatus {
        // SAFETY: handles of the host and NUL-terminated texts, as for all calls below.
        unsafe { self.props.propSetString.unwrap()(set, name.as_ptr(), index, value.as_ptr()) }
    }

    fn int(&self, set: OfxPropertySetHandle, name: &CStr, index: c_int, value: c_int) -> OfxStatus {
        // SAFETY: as above.
        unsafe { self.props.propSetInt.unwrap()(set, name.as_ptr(), index, value) }
    }

    fn double(&self, set: OfxPropertySetHandle, name: &CStr, value: f64) -> OfxStatus {
        // SAFETY: as above.
        unsafe { self.props.propSetDouble.unwrap()(set, name.as_ptr(), 0, value) }
    }

    fn ints<const N: usize>(&self, set: OfxPropertySetHandle, name: &CStr) -> [c_int; N] {
        let mut values = [0; N];
        // SAFETY: as above, with room for N values.
        unsafe { self.props.propGetIntN.unwrap()(set, name.as_ptr(), N as c_int, values.as_mut_ptr()) };
        values
    }

    fn pointer(&self, set: OfxPropertySetHandle, name: &CStr) -> *mut c_void {
        let mut value = null_mut();
        // SAFETY: as above.
        unsafe { self.props.propGetPointer.unwrap()(set, name.as_ptr(), 0, &mut value) };
        value
    }

    fn props_of(&self, effect: OfxImageEffectHandle) -> OfxPropertySetHandle {
        let mut props = null_mut();
        // SAFETY: as above.
        unsafe { self.effect.getPropertySet.unwrap()(effect, &mut props) };
        props
    }

    fn param(&self, effect: OfxImageEffectHandle, name: &CStr) -> OfxParamHandle {
        let (mut set, mut param) = (null_mut(), null_mut());
        // SAFETY: as above.
        unsafe {
            self.effect.getParamSet.unwrap()(effect, &mut set);
            self.params.paramGetHandle.unwrap()(set, name.as_ptr(), &mut param, null_mut());
        }
        param
    }

    fn clip(&self, effect: OfxImageEffectHandle, name: &CStr) -> OfxImageClipHandle {
        let mut clip = null_mut();
        // SAFETY: as above.
        unsafe { self.effect.clipGetHandle.unwrap()(effect, name.as_ptr(), &mut clip, null_mut()) };
        clip
    }

    fn image(&self, effect: OfxImageEffectHandle, clip: &CStr, time: f64) -> OfxPropertySetHandle {
        let mut image = null_mut();
        // SAFETY: as above.
        unsafe { self.effect.clipGetImage.unwrap()(self.clip(effect, clip), time, null(), &mut image) };
        image
    }

    fn release(&self, image: OfxPropertySetHandle) -> OfxStatus {
        // SAFETY: as above.
        unsafe { self.effect.clipReleaseImage.unwrap()(image) }
    }

    fn describe(&self, effect: OfxImageEffectHandle) {
        let props = self.props_of(effect);
        if !self.is(NO_LABEL) {
            self.text(props, kOfxPropLabel, 0, c"Double");
        }
        self.text(props, kOfxImageEffectPluginPropGrouping, 0, c"Tests");
        for (at, context) in Context::ALL.into_iter().enumerate() {
            self.text(props, kOfxImageEffectPropSupportedContexts, at as c_int, context.name());
        }
        if !self.is(NO_DEPTHS) {
            let depth = if self.is(UNKNOWN_DEPTH) { c"OfxBitDepthDouble" } else { kOfxBitDepthFloat };
            self.text(props, kOfxImageEffectPropSupportedPixelDepths, 0, depth);
        }
        self.text(props, kOfxImageEffectPluginRenderThreadSafety, 0, kOfxImageEffectRenderFullySafe);
        match self.fault {
            WRONG_TYPE => self.text(props, kOfxImageEffectPluginPropHostFrameThreading, 0, c"no"),
            UNKNOWN_PROPERTY => self.int(props, c"OfxPropNoSuchThing", 0, 1),
            WRONG_DIMENSION => self.text(props, kOfxPropLabel, 1, c"second"),
            READ_ONLY => self.text(props, kOfxPropType, 0, c"mine"),
            _ => self.int(props, kOfxImageEffectPluginPropHostFrameThreading, 0, 0),
        };
    }

    fn describe_in(&self, effect: OfxImageEffectHandle) {
        let clips: &[&CStr] = if self.is(NO_SOURCE) { &[c"Output"] } else { &[c"Source", c"Output"] };
        for clip in clips {
            let mut props = null_mut();
            // SAFETY: as above.
            unsafe { self.effect.clipDefine.unwrap()(effect, clip.as_ptr(), &mut props) };
            if !self.is(NO_COMPONENTS) {
                self.text(props, kOfxImageEffectPropSupportedComponents, 0, kOfxImageComponentRGBA);
            }
            self.int(props, kOfxImageClipPropOptional, 0, c_int::from(*clip == c"Source" && self.is(GOOD)));
        }
        let (mut set, mut gain, mut tint, mut status) = (null_mut(), null_mut(), null_mut(), null_mut());
        // SAFETY: as above.
        unsafe {
            self.effect.getParamSet.unwrap()(effect, &mut set);
            let define = self.params.paramDefine.unwrap();
            define(set, kOfxParamTypeDouble.as_ptr(), c"gain".as_ptr(), &mut gain);
            define(set, kOfxParamTypeRGB.as_ptr(), c"tint".as_ptr(), &mut tint);
            define(set, kOfxParamTypeString.as_ptr(), c"status".as_ptr(), &mut status);
        }
        for (props, label) in [(gain, c"Gain"), (tint, c"Tint"), (status, c"Status")] {
            self.text(props, kOfxPropLabel, 0, label);
        }
        let default = if self.is(BAD_DEFAULT) { 99.0 } else { 2.0 };
        self.double(gain, kOfxParamPropDefault, default);
        for (props, count) in [(gain, 1), (tint, 3)] {
            let limits = [kOfxParamPropMin, kOfxParamPropMax, kOfxParamPropDisplayMin, kOfxParamPropDisplayMax];
            for (limit, value) in limits.into_iter().zip([0.0, 10.0, 0.0, 4.0]) {
                let values = [value; 3];
                // SAFETY: as above.
                unsafe { self.props.propSetDoubleN.unwrap()(props, limit.as_ptr(), count, values.as_ptr()) };
            }
        }
    }

    fn create(&self, effect: OfxImageEffectHandle) {
        let status = self.param(effect, c"status");
        let tint = self.param(effect, c"tint");
        // SAFETY: as above; a text for a text, three numbers for a colour.
        unsafe {
            self.params.paramSetValue.unwrap()(status, c"ready".as_ptr());
            self.params.paramSetValue.unwrap()(tint, 1.0f64, 0.5f64, 0.25f64);
        }
        match self.fault {
            UNKNOWN_PARAM => drop(self.param(effect, c"gian")),
            UNKNOWN_CLIP => drop(self.clip(effect, c"Sauce")),
            LEAKS_MEMORY => {
                let memory: &OfxMemorySuiteV1 = suite(self.fault, kOfxMemorySuite, 1).unwrap();
                let mut block = null_mut();
                // SAFETY: as above.
                unsafe { memory.memoryAlloc.unwrap()(effect.cast(), 100, &mut block) };
            }
            LEAKS_IMAGE_MEMORY => {
                let mut block = null_mut();
                // SAFETY: as above.
                unsafe { self.effect.imageMemoryAlloc.unwrap()(effect, 100, &mut block) };
            }
            LEAKS_MUTEX => {
                let threads: &OfxMultiThreadSuiteV1 = suite(self.fault, kOfxMultiThreadSuite, 1).unwrap();
                let mut mutex = null_mut();
                // SAFETY: as above.
                unsafe { threads.mutexCreate.unwrap()(&mut mutex, 0) };
            }
            _ => {}
        }
    }

    /// Output = gain(time) * tint * Source, or gain * tint without a Source.
    fn render(&self, effect: OfxImageEffectHandle, args: OfxPropertySetHandle) -> OfxStatus {
        if self.is(SILENT_FAILURE) {
            return kOfxStatFailed;
        }
        let mut time = 0.0;
        let (mut gain, mut tint) = (0.0f64, [0.0f64; 3]);
        // SAFETY: as above, with as many pointers as the parameters have elements.
        unsafe {
            self.props.propGetDouble.unwrap()(args, kOfxPropTime.as_ptr(), 0, &mut time);
            self.params.paramGetValueAtTime.unwrap()(self.param(effect, c"gain"), time, &raw mut gain);
            let [r, g, b] = &mut tint;
            self.params.paramGetValue.unwrap()(self.param(effect, c"tint"), &raw mut *r, &raw mut *g, &raw mut *b);
        }
        if self.is(SETS_IN_RENDER) {
            // SAFETY: as above.
            unsafe { self.params.paramSetValue.unwrap()(self.param(effect, c"status"), c"rendered".as_ptr()) };
        }
        if gain > 9.0 {
            return self.complain(effect);
        }
        let window: [c_int; 4] = self.ints(args, kOfxImageEffectPropRenderWindow);
        let (output, source) = (self.image(effect, c"Output", time), self.image(effect, c"Source", time));
        self.fill(output, source, window, tint.map(|tint| (gain * tint) as f32));
        self.misbehave(output, source, window);
        self.release(output);
        if !source.is_null() && !self.is(LEAKS_IMAGE) {
            self.release(source);
        }
        match self.fault {
            STALE_IMAGE => drop(self.ints::<4>(output, kOfxImagePropBounds)),
            NULL_HANDLE => drop(self.ints::<4>(null_mut(), kOfxImagePropBounds)),
            _ => {}
        }
        kOfxStatOK
    }

    fn complain(&self, effect: OfxImageEffectHandle) -> OfxStatus {
        let message: &OfxMessageSuiteV2 = suite(self.fault, kOfxMessageSuite, 2).unwrap();
        let text = CString::new("too much: 100%").unwrap();
        let (kind, id, format) = (kOfxMessageError.as_ptr(), c"id".as_ptr(), c"%s (%d)".as_ptr());
        // SAFETY: as above, the arguments as the format says.
        unsafe { message.setPersistentMessage.unwrap()(effect.cast(), kind, id, format, text.as_ptr(), 10 as c_int) };
        kOfxStatFailed
    }

    fn address(&self, image: OfxPropertySetHandle, x: c_int, y: c_int) -> *mut f32 {
        let bounds: [c_int; 4] = self.ints(image, kOfxImagePropBounds);
        let [row_bytes] = self.ints(image, kOfxImagePropRowBytes);
        let data = self.pointer(image, kOfxImagePropData).cast::<u8>();
        data.wrapping_offset((y - bounds[1]) as isize * row_bytes as isize + (x - bounds[0]) as isize * 16).cast()
    }

    fn fill(&self, output: OfxPropertySetHandle, source: OfxPropertySetHandle, window: [c_int; 4], gain: [f32; 3]) {
        let defined: [c_int; 4] = if source.is_null() { [0; 4] } else { self.ints(source, kOfxImagePropBounds) };
        let [x1, y1, x2, y2] = window;
        for (x, y) in (y1..y2).flat_map(|y| (x1..x2).map(move |x| (x, y))) {
            if self.is(LEAVES_PIXELS) && x == x1 {
                continue;
            }
            let inside = (defined[0]..defined[2]).contains(&x) && (defined[1]..defined[3]).contains(&y);
            for c in 0..4 {
                let input = match (inside, source.is_null()) {
                    // SAFETY: a pixel inside the bounds of its image.
                    (true, _) => unsafe { *self.address(source, x, y).add(c) },
                    (false, none) => f32::from(none),
                };
                // SAFETY: as above.
                unsafe { *self.address(output, x, y).add(c) = input * gain.get(c).unwrap_or(&1.0) };
            }
        }
    }

    fn misbehave(&self, output: OfxPropertySetHandle, source: OfxPropertySetHandle, [x1, y1, x2, y2]: [c_int; 4]) {
        let bounds: [c_int; 4] = self.ints(output, kOfxImagePropBounds);
        // SAFETY: each writes inside the host's allocation, which has guard bands around the rows.
        unsafe {
            match self.fault {
                WRITES_OUTSIDE => *self.address(output, x2, y1) = 1.0,
                WRITES_PADDING => *self.address(output, bounds[2], y1) = 1.0,
                OVERRUNS => *self.address(output, bounds[0], bounds[1]).sub(1) = 1.0,
                WRITES_INPUT => *self.address(source, x1, y1) += 1.0,
                WRITES_AFTER_RELEASE => {
                    let address = self.address(output, x1, y2 - 1);
                    self.release(output);
                    *address += 1.0;
                }
                _ => {}
            }
        }
    }
}

unsafe extern "C" fn main_entry<const FAULT: Fault>(
    action: *const c_char,
    handle: *const c_void,
    inputs: OfxPropertySetHandle,
    _outputs: OfxPropertySetHandle,
) -> OfxStatus {
    let suites = Suites::new(FAULT);
    let effect = handle.cast_mut().cast();
    // SAFETY: the host names the action.
    match unsafe { CStr::from_ptr(action) } {
        action if action == kOfxActionLoad && FAULT == DEFAULT_FOR_LOAD => return kOfxStatReplyDefault,
        action if action == kOfxActionDestroyInstance && FAULT == DEFAULT_FOR_DESTROY => return kOfxStatReplyDefault,
        action if action == kOfxActionDescribe => suites.describe(effect),
        action if action == kOfxImageEffectActionDescribeInContext => suites.describe_in(effect),
        action if action == kOfxActionCreateInstance => suites.create(effect),
        action if action == kOfxImageEffectActionRender => return suites.render(effect, inputs),
        action if [kOfxActionLoad, kOfxActionUnload, kOfxActionDestroyInstance].contains(&action) => {}
        _ => return kOfxStatReplyDefault,
    }
    kOfxStatOK
}

/// The plugin with a fault.
fn plugin<const FAULT: Fault>() -> &'static OfxPlugin {
    Box::leak(Box::new(OfxPlugin {
        pluginApi: kOfxImageEffectPluginApi.as_ptr(),
        apiVersion: 1,
        pluginIdentifier: c"org.relume.tests.double".as_ptr(),
        pluginVersionMajor: 1,
        pluginVersionMinor: 0,
        setHost: Some(set_host::<FAULT>),
        mainEntry: Some(main_entry::<FAULT>),
    }))
}

fn ramp(width: usize, height: usize) -> TestImage {
    TestImage::from_fn(width, height, |x, y| [x as f32, y as f32, (x * y) as f32, 1.0])
}

/// Whether the tests can run here.
fn supported() -> bool {
    if !VARIADICS_SUPPORTED {
        relume_tests::skipped("variadic suite functions on this platform");
    }
    VARIADICS_SUPPORTED
}

/// Runs a bad plugin through one render of a tile with padded rows, and returns the rules it broke.
fn broken<const FAULT: Fault>() -> Vec<Rule> {
    let host = Host::new(Options { fail_on_drop: false, ..Options::default() });
    if let Ok(plugin) = host.adopt(plugin::<FAULT>()) {
        let instance = plugin.create(Context::Filter).expect("only Load and render fail here");
        if FAULT != NO_SOURCE {
            instance.clip("Source").connect(ramp(12, 10));
        }
        let window = Some(Rect::new(2, 1, 8, 7));
        let bounds = Some(Rect::new(0, 0, 12, 10));
        instance.render(&RenderArgs { window, bounds, row_padding: 16, ..RenderArgs::default() });
    }
    let mut rules: Vec<_> = host.take_violations().into_iter().map(|violation| violation.rule).collect();
    rules.dedup();
    rules
}

#[test]
fn a_good_plugin_passes_whatever_the_memory_is_like() {
    if !supported() {
        return;
    }
    let host = Host::new(Options::default());
    let plugin = host.adopt(plugin::<GOOD>()).unwrap();
    for context in Context::ALL {
        let instance = plugin.create(context).unwrap();
        assert_eq!(instance.string("status"), "ready");
        assert_eq!(instance.numbers("tint", 1.0), [1.0, 0.5, 0.25]);
        instance.set_keys("gain", &[(0.0, 0.0), (10.0, 5.0)]);
        let source = ramp(13, 9).at(-4, 3);
        let expected = TestImage::from_fn(13, 9, |x, y| {
            let [r, g, b, a] = source.pixel(x, y);
            [r * 2.0, g, b * 0.5, a]
        });
        let expected = expected.at(-4, 3);
        for (padding, negative) in [(0, false), (16, false), (0, true), (48, true)] {
            instance.clip("Source").connect(source.clone().rows(padding, !negative));
            let args = RenderArgs {
                time: 4.0,
                bounds: Some(source.bounds()),
                row_padding: padding,
                negative_rows: negative,
                ..RenderArgs::default()
            };
            assert_eq!(instance.render(&args).unwrap(), expected);
            assert_eq!(instance.render_tiles(&args, 5), expected);
        }
    }
}

#[test]
fn renders_from_threads_each_get_their_own_output() {
    if !supported() {
        return;
    }
    let host = Host::new(Options::default());
    let plugin = host.adopt(plugin::<GOOD>()).unwrap();
    let instance = plugin.create(Context::General).unwrap();
    instance.animate("gain", |time| time / 8.0);
    instance.clip("Source").connect_frames(|time| (time < 30.0).then(|| TestImage::constant(8, 6, [time as f32; 4])));
    let frames: Vec<_> = (0..40)
        .map(|time| RenderArgs { time: f64::from(time), bounds: Some(Rect::new(0, 0, 8, 6)), ..RenderArgs::default() })
        .collect();
    for (time, rendered) in instance.render_from_threads(&frames, 4).into_iter().enumerate() {
        let time = time as f32;
        let source = if time < 30.0 { time } else { 1.0 };
        assert_eq!(rendered.unwrap().pixel(7, 5)[0], source * time / 8.0);
    }
}

#[test]
fn failures_with_a_message_are_no_violation() {
    if !supported() {
        return;
    }
    let host = Host::new(Options::default());
    let plugin = host.adopt(plugin::<GOOD>()).unwrap();
    let instance = plugin.create(Context::Filter).unwrap();
    instance.set_double("gain", 9.5);
    let rendered = instance.render(&RenderArgs::default());
    assert!(rendered.failed());
    assert_eq!(rendered.untouched, 64 * 48);
    assert_eq!(instance.persistent_message().unwrap().text, "too much: 100% (10)");
}

macro_rules! caught {
    ($($name:ident: $fault:ident => $rule:ident;)*) => {$(
        #[test]
        fn $name() {
            if supported() {
                assert_eq!(broken::<$fault>(), [Rule::$rule]);
            }
        }
    )*};
}

caught! {
    a_leaked_image_is_caught: LEAKS_IMAGE => LeakedImage;
    a_pixel_outside_the_window_is_caught: WRITES_OUTSIDE => OutsideWindow;
    a_property_of_the_wrong_type_is_caught: WRONG_TYPE => WrongType;
    a_missing_label_is_caught: NO_LABEL => Missing;
    a_default_reply_to_load_is_caught: DEFAULT_FOR_LOAD => Status;
    a_default_reply_to_destroy_is_caught: DEFAULT_FOR_DESTROY => Status;
    written_padding_is_caught: WRITES_PADDING => Padding;
    an_overrun_is_caught: OVERRUNS => Overrun;
    a_null_handle_is_caught: NULL_HANDLE => NullHandle;
    a_stale_image_is_caught: STALE_IMAGE => StaleHandle;
    an_unknown_parameter_is_caught: UNKNOWN_PARAM => UnknownName;
    an_unknown_clip_is_caught: UNKNOWN_CLIP => UnknownName;
    an_unknown_property_is_caught: UNKNOWN_PROPERTY => UnknownName;
    a_wrong_dimension_is_caught: WRONG_DIMENSION => WrongDimension;
    a_read_only_property_is_caught: READ_ONLY => ReadOnly;
    leaked_memory_is_caught: LEAKS_MEMORY => LeakedMemory;
    leaked_image_memory_is_caught: LEAKS_IMAGE_MEMORY => LeakedMemory;
    a_leaked_mutex_is_caught: LEAKS_MUTEX => LeakedMutex;
    a_written_input_is_caught: WRITES_INPUT => InputWritten;
    pixels_left_alone_are_caught: LEAVES_PIXELS => Unwritten;
    a_failure_without_message_is_caught: SILENT_FAILURE => NoMessage;
    setting_a_value_in_render_is_caught: SETS_IN_RENDER => NotAllowed;
    components_not_set_are_caught: NO_COMPONENTS => Missing;
    a_default_outside_its_range_is_caught: BAD_DEFAULT => BadValue;
    missing_depths_are_caught: NO_DEPTHS => Missing;
}

#[test]
fn writes_after_release_and_double_release_are_caught() {
    if supported() {
        assert_eq!(broken::<WRITES_AFTER_RELEASE>(), [Rule::StaleHandle, Rule::AfterRelease]);
    }
}

#[test]
fn a_depth_unknown_to_the_standard_is_caught() {
    if supported() {
        assert_eq!(broken::<UNKNOWN_DEPTH>(), [Rule::BadValue, Rule::Missing]);
    }
}

#[test]
fn a_filter_without_source_is_caught() {
    if supported() {
        assert_eq!(broken::<NO_SOURCE>()[0], Rule::Missing);
    }
}

#[test]
#[should_panic(expected = "the plugin broke 1 rules")]
fn a_violation_fails_the_test_that_drops_its_host() {
    if !supported() {
        panic!("the plugin broke 1 rules (not tried on this platform)");
    }
    let host = Host::new(Options::default());
    drop(host.adopt(plugin::<DEFAULT_FOR_LOAD>()));
}
