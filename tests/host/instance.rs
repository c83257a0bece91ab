//! An instance: its parameters as a user sets them, its clips, and the actions that ask it something.

use std::collections::BTreeMap;
use std::ffi::CStr;
use std::sync::Arc;

use super::check::in_range;
use super::clip::{Clip, Feed, Frames};
use super::effect::{Effect, Role};
use super::image::TestImage;
use super::log::{Message, Rule, Violation};
use super::ofx::*;
use super::param::{Curve, Param, Track, text_value};
use super::plugin::{Context, Core};
use super::props::{Prop, Row, Value};
use super::schema::{self, row};
use super::shared::lock;
use super::suite_param::note_animation;

/// An effect instance. Destroyed when dropped. Renders may run on several threads through one reference.
pub struct Instance {
    pub(super) core: Arc<Core>,
    pub(super) effect: Arc<Effect>,
    /// The context it was made for.
    pub context: Context,
}

/// What a plugin wants its clips to be.
#[derive(Debug, Clone, PartialEq)]
pub struct ClipPreferences {
    /// Components by clip.
    pub components: BTreeMap<String, String>,
    /// Depth by clip.
    pub depths: BTreeMap<String, String>,
    /// How the output's colour relates to its alpha.
    pub premultiplication: String,
    /// Frames per second of the output.
    pub frame_rate: f64,
    /// Whether it changes with time though nothing else does.
    pub frame_varying: bool,
}

const OK_OR_DEFAULT: [OfxStatus; 2] = [kOfxStatOK, kOfxStatReplyDefault];

impl Instance {
    pub(super) fn create(core: &Arc<Core>, from: &Effect, context: Context, plugin: usize) -> Result<Self, String> {
        let shared = &core.shared;
        let rows = schema::instance(from.props.rows(), &name(context.name()), plugin, &shared.options);
        let effect = Effect::new(shared, Role::Instance, rows);
        for param in lock(&from.params).iter() {
            let copy = Param::new(shared, &effect, &param.kind, &param.name, param.instance_rows());
            copy.props.put(kOfxPropType, Prop::text(kOfxTypeParameterInstance));
            lock(&effect.params).push(copy);
        }
        for clip in lock(&from.clips).iter() {
            let rows = schema::clip_instance(clip.props.rows(), &shared.options);
            let copy = Clip::new(shared, &effect, &clip.name, rows);
            lock(&effect.clips).push(copy);
        }
        if let Some(output) = effect.clip("Output") {
            output.props.put(kOfxImageClipPropConnected, Prop::ints(&[1]));
        }
        if core.must(kOfxActionCreateInstance, effect.handle(), None) {
            return Ok(Self { core: Arc::clone(core), effect, context });
        }
        effect.close();
        Err("the action CreateInstance failed".into())
    }

    fn param(&self, param: &str) -> Arc<Param> {
        self.effect.param(param).unwrap_or_else(|| panic!("there is no parameter {param:?}"))
    }

    /// Gives a parameter a track, checks it, and tells the plugin as after a user's edit.
    fn assign(&self, param: &str, track: Track) {
        let found = self.param(param);
        let sample = track.at(self.core.shared.options.frame_range.0);
        assert!(found.holds(&sample), "{param} is a {}, not {sample:?}", found.kind);
        assert!(in_range(&found, &sample), "{param}: {sample:?} is out of its range");
        note_animation(&found, &track);
        *lock(&found.track) = track;
        if self.core.shared.options.notify {
            self.changed(kOfxTypeParameter, param);
        }
    }

    /// Sets a text.
    ///
    /// # Panics
    /// When there is no such parameter or it is of another kind, as all setters do.
    pub fn set_string(&self, param: &str, value: &str) {
        self.assign(param, Track::Still(text_value(value)));
    }

    /// Sets a number.
    pub fn set_double(&self, param: &str, value: f64) {
        self.assign(param, Track::Still(vec![Value::Double(value)]));
    }

    /// Sets the numbers of a vector or colour.
    pub fn set_doubles(&self, param: &str, values: &[f64]) {
        self.assign(param, Track::Still(values.iter().copied().map(Value::Double).collect()));
    }

    /// Sets a whole number.
    pub fn set_int(&self, param: &str, value: i32) {
        self.assign(param, Track::Still(vec![Value::Int(value)]));
    }

    /// Sets a switch.
    pub fn set_bool(&self, param: &str, value: bool) {
        self.set_int(param, i32::from(value));
    }

    /// Sets a choice by its index.
    pub fn set_choice(&self, param: &str, option: usize) {
        let options = self.param(param).props.texts(kOfxParamPropChoiceOption).len();
        assert!(option < options, "{param} has {options} options");
        self.set_int(param, i32::try_from(option).expect("few options"));
    }

    /// Sets a choice by its label.
    pub fn set_choice_label(&self, param: &str, label: &str) {
        let options = self.param(param).props.texts(kOfxParamPropChoiceOption);
        let at = options.iter().position(|option| option == label);
        self.set_choice(param, at.unwrap_or_else(|| panic!("{label:?} is none of {options:?}")));
    }

    /// Sets keys of a number: `(time, value)`, linear between.
    pub fn set_keys(&self, param: &str, keys: &[(f64, f64)]) {
        let mut track = Track::Keys(Vec::new());
        keys.iter().for_each(|&(time, value)| track.key(time, vec![Value::Double(value)]));
        self.assign(param, track);
    }

    /// Makes a number a function of time.
    pub fn animate(&self, param: &str, curve: impl Fn(f64) -> f64 + Send + Sync + 'static) {
        let curve: Curve = Arc::new(move |time| vec![Value::Double(curve(time))]);
        self.assign(param, Track::Curve(curve));
    }

    /// Makes a whole number, switch or choice a function of time.
    pub fn animate_int(&self, param: &str, curve: impl Fn(f64) -> i32 + Send + Sync + 'static) {
        let curve: Curve = Arc::new(move |time| vec![Value::Int(curve(time))]);
        self.assign(param, Track::Curve(curve));
    }

    /// Makes a text a function of time.
    pub fn animate_string(&self, param: &str, curve: impl Fn(f64) -> String + Send + Sync + 'static) {
        let curve: Curve = Arc::new(move |time| text_value(&curve(time)));
        self.assign(param, Track::Curve(curve));
    }

    /// The text of a parameter now (the plugin may have set it).
    pub fn string(&self, param: &str) -> String {
        match lock(&self.param(param).track).at(*lock(&self.core.shared.timeline)).first() {
            Some(Value::Text(text)) => text.to_string_lossy().into_owned(),
            other => panic!("{param} holds {other:?}, no text"),
        }
    }

    /// The numbers of a parameter at a time, whole or not.
    pub fn numbers(&self, param: &str, time: f64) -> Vec<f64> {
        let number = |value| match value {
            Value::Int(value) => Some(f64::from(value)),
            Value::Double(value) => Some(value),
            _ => None,
        };
        lock(&self.param(param).track).at(time).into_iter().filter_map(number).collect()
    }

    /// Numbers of a property of a parameter of this instance (enabled, secret).
    pub fn param_numbers(&self, param: &str, property: &CStr) -> Vec<f64> {
        self.param(param).props.numbers(property)
    }

    /// A clip.
    ///
    /// # Panics
    /// When there is none of that name.
    pub fn clip(&self, clip: &str) -> ClipInput<'_> {
        let found = self.effect.clip(clip).unwrap_or_else(|| panic!("there is no clip {clip:?}"));
        ClipInput { instance: self, clip: found }
    }

    /// Runs InstanceChanged, between its begin and end, for a user's edit of a parameter (`kOfxTypeParameter`) or clip
    /// (`kOfxTypeClip`).
    pub fn changed(&self, kind: &CStr, what: &str) {
        let reason = row(kOfxPropChangeReason, Prop::text(kOfxChangeUserEdited));
        let brackets = self.core.args("arguments of BeginInstanceChanged", vec![reason.clone()]);
        let args = self.core.args(
            "arguments of InstanceChanged",
            vec![
                reason,
                row(kOfxPropType, Prop::text(kind)),
                row(kOfxPropName, Prop::texts(&[what])),
                row(kOfxPropTime, Prop::doubles(&[*lock(&self.core.shared.timeline)])),
                row(kOfxImageEffectPropRenderScale, Prop::doubles(&[1.0, 1.0])),
            ],
        );
        let steps = [
            (kOfxActionBeginInstanceChanged, &brackets),
            (kOfxActionInstanceChanged, &args),
            (kOfxActionEndInstanceChanged, &brackets),
        ];
        for (action, args) in steps {
            let status = self.core.act(action, self.effect.handle(), (Some(args), None), None);
            self.core.expect(action, status, &OK_OR_DEFAULT);
        }
        brackets.close();
        args.close();
    }

    /// Runs an action without arguments that may answer default (PurgeCaches, SyncPrivateData).
    pub fn plain_action(&self, action: &CStr) {
        let status = self.core.act(action, self.effect.handle(), (None, None), None);
        self.core.expect(action, status, &OK_OR_DEFAULT);
    }

    fn ask<T>(
        &self,
        action: &CStr,
        inputs: Vec<Row>,
        outputs: Vec<Row>,
        read: impl FnOnce(&super::props::PropertySet) -> T,
    ) -> (OfxStatus, T) {
        let inputs = self.core.args(&format!("in arguments of {}", name(action)), inputs);
        let outputs = self.core.args(&format!("out arguments of {}", name(action)), outputs);
        let status = self.core.act(action, self.effect.handle(), (Some(&inputs), Some(&outputs)), None);
        let answer = read(&outputs);
        inputs.close();
        outputs.close();
        (status, answer)
    }

    /// What the host takes for the region of definition when the plugin has no opinion.
    pub fn default_region(&self, time: f64) -> [f64; 4] {
        let options = &self.core.shared.options;
        let source = self.effect.clip("Source").and_then(|clip| clip.picture(time));
        if let Some(image) = source.filter(|_| self.context != Context::Generator) {
            let [x1, y1, x2, y2] = image.bounds().edges().map(f64::from);
            return [x1 * options.pixel_aspect, y1, x2 * options.pixel_aspect, y2];
        }
        let ((x, y), (w, h)) = (options.project_offset, options.project_extent);
        [x, y, x + w, y + h]
    }

    /// The region of definition at a time, canonical: left, bottom, right, top.
    pub fn region_of_definition(&self, time: f64) -> [f64; 4] {
        let action = kOfxImageEffectActionGetRegionOfDefinition;
        let default = self.default_region(time);
        let (status, answer) = self.ask(
            action,
            vec![
                row(kOfxPropTime, Prop::doubles(&[time])),
                row(kOfxImageEffectPropRenderScale, Prop::doubles(&[1.0, 1.0])),
            ],
            vec![row(kOfxImageEffectPropRegionOfDefinition, Prop::doubles(&default).writable())],
            |out| out.numbers(kOfxImageEffectPropRegionOfDefinition),
        );
        self.core.expect(action, status, &[kOfxStatOK, kOfxStatReplyDefault, kOfxStatFailed]);
        if status != kOfxStatOK {
            return default;
        }
        match <[f64; 4]>::try_from(answer) {
            Ok(region) if region[0] <= region[2] && region[1] <= region[3] => region,
            other => {
                self.core.shared.violate(Rule::BadValue, format!("the region of definition {other:?}"));
                default
            }
        }
    }

    /// The regions of interest of all inputs for a canonical region of the output; `None` when the plugin has no
    /// opinion, which means that region.
    pub fn regions_of_interest(&self, time: f64, region: [f64; 4]) -> Option<BTreeMap<String, [f64; 4]>> {
        let action = kOfxImageEffectActionGetRegionsOfInterest;
        let inputs: Vec<_> = self.clip_names().into_iter().filter(|clip| clip != "Output").collect();
        let property = |clip: &str| format!("OfxImageClipPropRoI_{clip}");
        let rows = inputs.iter().map(|clip| (property(clip), Prop::doubles(&region).writable())).collect();
        let (status, answer) = self.ask(
            action,
            vec![
                row(kOfxPropTime, Prop::doubles(&[time])),
                row(kOfxImageEffectPropRenderScale, Prop::doubles(&[1.0, 1.0])),
                row(kOfxImageEffectPropRegionOfInterest, Prop::doubles(&region)),
            ],
            rows,
            |out| {
                let region = |clip: &String| out.numbers_named(&property(clip)).try_into().unwrap_or_default();
                inputs.iter().map(|clip| (clip.clone(), region(clip))).collect()
            },
        );
        self.core.expect(action, status, &OK_OR_DEFAULT);
        (status == kOfxStatOK).then_some(answer)
    }

    /// The frames of each input needed for a time: pairs of first and last; `None` when the plugin has no opinion.
    pub fn frames_needed(&self, time: f64) -> Option<BTreeMap<String, Vec<f64>>> {
        let action = kOfxImageEffectActionGetFramesNeeded;
        let inputs: Vec<_> = self.clip_names().into_iter().filter(|clip| clip != "Output").collect();
        let property = |clip: &str| format!("OfxImageClipPropFrameRange_{clip}");
        let range = Prop { dimension: None, ..Prop::doubles(&[time, time]).writable() };
        let rows = inputs.iter().map(|clip| (property(clip), range.clone())).collect();
        let at = vec![row(kOfxPropTime, Prop::doubles(&[time]))];
        let (status, answer) = self.ask(action, at, rows, |out| {
            inputs.iter().map(|clip| (clip.clone(), out.numbers_named(&property(clip)))).collect()
        });
        self.core.expect(action, status, &OK_OR_DEFAULT);
        (status == kOfxStatOK).then_some(answer)
    }

    /// The clip preferences: the plugin's, on top of the host's defaults.
    pub fn clip_preferences(&self) -> ClipPreferences {
        let action = kOfxImageEffectActionGetClipPreferences;
        let clips = self.clip_names();
        let options = &self.core.shared.options;
        let rows = schema::clip_preferences(&clips, options.depth.name(), options);
        let (status, answer) = self.ask(action, Vec::new(), rows, |out| {
            let by_clip = |what: &str| {
                let text = |clip: &String| out.text(&c_string(&format!("OfxImageClipProp{what}_{clip}")));
                clips.iter().map(|clip| (clip.clone(), text(clip))).collect()
            };
            ClipPreferences {
                components: by_clip("Components"),
                depths: by_clip("Depth"),
                premultiplication: out.text(kOfxImageEffectPropPreMultiplication),
                frame_rate: out.numbers(kOfxImageEffectPropFrameRate).first().copied().unwrap_or(0.0),
                frame_varying: out.numbers(kOfxImageEffectFrameVarying) == [1.0],
            }
        });
        self.core.expect(action, status, &OK_OR_DEFAULT);
        answer
    }

    /// First and last frame, when the plugin has an opinion.
    pub fn time_domain(&self) -> Option<(f64, f64)> {
        let action = kOfxImageEffectActionGetTimeDomain;
        let (first, last) = self.core.shared.options.frame_range;
        let rows = vec![row(kOfxImageEffectPropFrameRange, Prop::doubles(&[first, last]).writable())];
        let read = |out: &super::props::PropertySet| out.numbers(kOfxImageEffectPropFrameRange);
        let (status, answer) = self.ask(action, Vec::new(), rows, read);
        self.core.expect(action, status, &OK_OR_DEFAULT);
        (status == kOfxStatOK).then(|| (answer[0], answer[1]))
    }

    /// The clip and time that this render would merely copy, if it would.
    pub fn identity(&self, args: &super::RenderArgs) -> Option<(String, f64)> {
        let action = kOfxImageEffectActionIsIdentity;
        let rows = vec![
            row(kOfxPropName, Prop::text(c"").writable()),
            row(kOfxPropTime, Prop::doubles(&[args.time]).writable()),
        ];
        let (status, answer) = self.ask(action, self.identity_arguments(args), rows, |out| {
            (out.text(kOfxPropName), out.numbers(kOfxPropTime)[0])
        });
        self.core.expect(action, status, &OK_OR_DEFAULT);
        if status == kOfxStatOK && self.effect.clip(&answer.0).is_none() {
            self.core.shared.violate(Rule::UnknownName, format!("identity of the clip {:?}", answer.0));
        }
        (status == kOfxStatOK).then_some(answer)
    }

    fn clip_names(&self) -> Vec<String> {
        lock(&self.effect.clips).iter().map(|clip| clip.name.clone()).collect()
    }

    /// The message that stays on this instance.
    pub fn persistent_message(&self) -> Option<Message> {
        lock(&self.core.shared.persistent).get(&(self.effect.handle() as usize)).cloned()
    }

    /// All messages shown in this host so far.
    pub fn messages(&self) -> Vec<Message> {
        lock(&self.core.shared.messages).clone()
    }

    /// All violations so far.
    pub fn violations(&self) -> Vec<Violation> {
        lock(&self.core.shared.log).clone()
    }
}

impl Drop for Instance {
    fn drop(&mut self) {
        self.core.must(kOfxActionDestroyInstance, self.effect.handle(), None);
        let handle = self.effect.handle() as usize;
        lock(&self.core.shared.persistent).remove(&handle);
        let open = lock(&self.core.shared.progress).remove(&handle).unwrap_or(0);
        if open > 0 {
            self.core.shared.violate(Rule::Unbalanced, format!("{open} progress bars were not closed"));
        }
        self.effect.close();
    }
}

/// An input clip of an instance.
pub struct ClipInput<'a> {
    instance: &'a Instance,
    clip: Arc<Clip>,
}

impl ClipInput<'_> {
    fn feed(&self, feed: Feed) {
        self.clip.connect(feed);
        if self.instance.core.shared.options.notify {
            self.instance.changed(kOfxTypeClip, &self.clip.name);
        }
    }

    /// Connects a picture, the same at all times.
    pub fn connect(&self, image: TestImage) {
        self.feed(Feed::Image(Arc::new(image)));
    }

    /// Connects a picture for each time; none where the function returns `None`.
    pub fn connect_frames(&self, frames: impl Fn(f64) -> Option<TestImage> + Send + Sync + 'static) {
        let frames: Frames = Arc::new(frames);
        self.feed(Feed::Frames(frames));
    }

    /// Disconnects.
    pub fn disconnect(&self) {
        self.feed(Feed::Nothing);
    }

    /// Says that it is connected, but getting an image fails.
    pub fn connect_without_image(&self) {
        self.feed(Feed::NoImage);
    }

    /// Says that it is connected; getting an image is OK and gives a NULL handle.
    pub fn connect_null_image(&self) {
        self.feed(Feed::NullImage);
    }

    /// Says that it is connected; the image has NULL for its pixels.
    pub fn connect_without_pixels(&self) {
        self.feed(Feed::NoData);
    }

    /// Makes the property Connected disappear, or come back.
    pub fn hide_connected(&self, hidden: bool) {
        self.clip.props.hide(kOfxImageClipPropConnected, hidden);
    }

    /// Sets how colour relates to alpha: `kOfxImagePreMultiplied` and its like.
    pub fn set_premultiplication(&self, alpha: &CStr) {
        self.clip.props.put(kOfxImageEffectPropPreMultiplication, Prop::text(alpha));
    }
}
