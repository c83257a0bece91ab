//! Parameters: their property tables, their values, keys and curves.

use std::ffi::{CStr, CString};
use std::sync::{Arc, Mutex, Weak};

use super::effect::Effect;
use super::ofx::*;
use super::props::{Prop, PropertySet, Row, Type, Value};
use super::registry::{Object, register, retire};
use super::schema::row;
use super::shared::{Shared, lock};

/// The kinds of parameter this host has.
pub const KINDS: &[&CStr] = &[
    kOfxParamTypeInteger,
    kOfxParamTypeDouble,
    kOfxParamTypeBoolean,
    kOfxParamTypeChoice,
    kOfxParamTypeRGBA,
    kOfxParamTypeRGB,
    kOfxParamTypeDouble2D,
    kOfxParamTypeInteger2D,
    kOfxParamTypeDouble3D,
    kOfxParamTypeInteger3D,
    kOfxParamTypeString,
    kOfxParamTypeCustom,
    kOfxParamTypeGroup,
    kOfxParamTypePage,
    kOfxParamTypePushButton,
];

/// What the value of a kind of parameter is made of: type and number of elements; none for groups, pages, buttons.
pub fn shape(kind: &str) -> (Type, usize) {
    match kind {
        "OfxParamTypeInteger" | "OfxParamTypeBoolean" | "OfxParamTypeChoice" => (Type::Int, 1),
        "OfxParamTypeInteger2D" => (Type::Int, 2),
        "OfxParamTypeInteger3D" => (Type::Int, 3),
        "OfxParamTypeDouble" => (Type::Double, 1),
        "OfxParamTypeDouble2D" => (Type::Double, 2),
        "OfxParamTypeDouble3D" | "OfxParamTypeRGB" => (Type::Double, 3),
        "OfxParamTypeRGBA" => (Type::Double, 4),
        "OfxParamTypeString" | "OfxParamTypeCustom" => (Type::Text, 1),
        _ => (Type::Int, 0),
    }
}

/// A value that depends on time.
pub type Curve = Arc<dyn Fn(f64) -> Vec<Value> + Send + Sync>;

/// The value of a parameter.
#[derive(Clone)]
pub enum Track {
    /// At all times.
    Still(Vec<Value>),
    /// At these times (sorted); numbers are interpolated linearly.
    Keys(Vec<(f64, Vec<Value>)>),
    /// A function of time.
    Curve(Curve),
}

impl Track {
    /// The value at a time.
    pub fn at(&self, time: f64) -> Vec<Value> {
        match self {
            Self::Still(values) => values.clone(),
            Self::Curve(curve) => curve(time),
            Self::Keys(keys) => {
                let next = keys.partition_point(|(key, _)| *key <= time);
                match (next.checked_sub(1).and_then(|at| keys.get(at)), keys.get(next)) {
                    (Some((t0, a)), Some((t1, b))) => {
                        let amount = (time - t0) / (t1 - t0);
                        a.iter().zip(b).map(|(a, b)| between(a, b, amount)).collect()
                    }
                    (Some((_, only)), None) | (None, Some((_, only))) => only.clone(),
                    (None, None) => Vec::new(),
                }
            }
        }
    }

    /// Sets a key.
    pub fn key(&mut self, time: f64, values: Vec<Value>) {
        let mut keys = if let Self::Keys(keys) = self { std::mem::take(keys) } else { Vec::new() };
        keys.retain(|(key, _)| *key != time);
        keys.push((time, values));
        keys.sort_by(|a, b| a.0.total_cmp(&b.0));
        *self = Self::Keys(keys);
    }
}

fn between(a: &Value, b: &Value, amount: f64) -> Value {
    match (a, b) {
        (Value::Double(a), Value::Double(b)) => Value::Double(a + (b - a) * amount),
        _ => a.clone(),
    }
}

/// A parameter, described or of an instance.
pub struct Param {
    /// Its script name.
    pub name: String,
    /// `OfxParamTypeDouble` and its like.
    pub kind: String,
    /// Its properties.
    pub props: Arc<PropertySet>,
    /// Its value; meaningless in a descriptor.
    pub track: Mutex<Track>,
    /// Whose it is.
    pub effect: Weak<Effect>,
    handle: Mutex<usize>,
}

impl Param {
    /// A new parameter with handles.
    pub fn new(shared: &Arc<Shared>, effect: &Arc<Effect>, kind: &str, name: &str, rows: Vec<Row>) -> Arc<Self> {
        let props = PropertySet::new(shared, format!("parameter {name}"), rows);
        let default = props.get(kOfxParamPropDefault).map(|prop| prop.values).unwrap_or_default();
        let param = Arc::new(Self {
            name: name.into(),
            kind: kind.into(),
            props,
            track: Mutex::new(Track::Still(default)),
            effect: Arc::downgrade(effect),
            handle: Mutex::new(0),
        });
        *lock(&param.handle) = register(shared, Object::Param(Arc::clone(&param)));
        param
    }

    /// The handle to give to plugins.
    pub fn handle(&self) -> OfxParamHandle {
        *lock(&self.handle) as OfxParamHandle
    }

    /// Takes the handles back.
    pub fn close(&self) {
        self.props.close();
        retire(*lock(&self.handle));
    }

    /// Whether its value is made of these.
    pub fn holds(&self, values: &[Value]) -> bool {
        let (kind, count) = shape(&self.kind);
        values.len() == count && values.iter().all(|value| value.kind() == kind)
    }

    /// The parameter for an instance: the values of the descriptor, and what is now the host's to write.
    pub fn instance_rows(&self) -> Vec<Row> {
        let open = [
            kOfxPropLabel,
            kOfxPropShortLabel,
            kOfxPropLongLabel,
            kOfxParamPropHint,
            kOfxParamPropEnabled,
            kOfxParamPropSecret,
            kOfxParamPropMin,
            kOfxParamPropMax,
            kOfxParamPropDisplayMin,
            kOfxParamPropDisplayMax,
            kOfxParamPropDefault,
            kOfxParamPropChoiceOption,
            kOfxParamPropEvaluateOnChange,
            kOfxParamPropDataPtr,
            kOfxParamPropGroupOpen,
            kOfxParamPropIncrement,
            kOfxParamPropDigits,
        ]
        .map(name);
        let lock = |(name, prop): Row| {
            let writable = prop.writable && open.contains(&name);
            (name, Prop { writable, ..prop })
        };
        self.props.rows().into_iter().map(lock).collect()
    }
}

const CACHES: &[&CStr] = &[kOfxParamInvalidateValueChange, kOfxParamInvalidateValueChangeToEnd, kOfxParamInvalidateAll];
const STRING_MODES: &[&CStr] = &[
    kOfxParamStringIsSingleLine,
    kOfxParamStringIsMultiLine,
    kOfxParamStringIsFilePath,
    kOfxParamStringIsDirectoryPath,
    kOfxParamStringIsLabel,
    kOfxParamStringIsRichTextFormat,
];
const DOUBLE_TYPES: &[&CStr] = &[
    kOfxParamDoubleTypePlain,
    kOfxParamDoubleTypeScale,
    kOfxParamDoubleTypeAngle,
    kOfxParamDoubleTypeTime,
    kOfxParamDoubleTypeAbsoluteTime,
    kOfxParamDoubleTypeX,
    kOfxParamDoubleTypeY,
    kOfxParamDoubleTypeXAbsolute,
    kOfxParamDoubleTypeYAbsolute,
    kOfxParamDoubleTypeXY,
    kOfxParamDoubleTypeXYAbsolute,
];
const COORDINATES: &[&CStr] = &[kOfxParamCoordinatesCanonical, kOfxParamCoordinatesNormalised];

/// The property table of a new parameter.
pub fn descriptor(kind: &str, param: &str) -> Vec<Row> {
    let flag = |value| Prop::ints(&[value]).writable();
    let text = |value| Prop::text(value).writable();
    let mut rows = vec![
        row(kOfxPropType, Prop::text(kOfxTypeParameter)),
        row(kOfxPropName, Prop::texts(&[param])),
        row(kOfxPropLabel, Prop::texts(&[param]).writable()),
        row(kOfxPropShortLabel, Prop::texts(&[param]).writable()),
        row(kOfxPropLongLabel, Prop::texts(&[param]).writable()),
        row(kOfxPropIcon, Prop::texts(&["", ""]).writable()),
        row(kOfxParamPropType, Prop::texts(&[kind])),
        row(kOfxParamPropSecret, flag(0)),
        row(kOfxParamPropEnabled, flag(1)),
        row(kOfxParamPropHint, text(c"")),
        row(kOfxParamPropScriptName, Prop::texts(&[param]).writable()),
        row(kOfxParamPropParent, text(c"")),
        row(kOfxParamPropDataPtr, Prop::pointer(0).writable()),
    ];
    let (value, count) = shape(kind);
    if count > 0 {
        rows.extend(value_rows(kind));
        rows.push(row(kOfxParamPropDefault, default(value, count)));
    }
    rows.extend(kind_rows(kind));
    rows
}

fn default(kind: Type, count: usize) -> Prop {
    match kind {
        Type::Double => Prop::doubles(&vec![0.0; count]).writable(),
        Type::Text => Prop::texts(&[""]).writable(),
        _ => Prop::ints(&vec![0; count]).writable(),
    }
}

fn value_rows(kind: &str) -> Vec<Row> {
    let flag = |value| Prop::ints(&[value]).writable();
    let animates =
        !matches!(kind, "OfxParamTypeString" | "OfxParamTypeCustom" | "OfxParamTypeBoolean" | "OfxParamTypeChoice");
    vec![
        row(kOfxParamPropAnimates, flag(i32::from(animates))),
        row(kOfxParamPropIsAnimating, Prop::ints(&[0])),
        row(kOfxParamPropIsAutoKeying, Prop::ints(&[0])),
        row(kOfxParamPropPersistant, flag(1)),
        row(kOfxParamPropEvaluateOnChange, flag(1)),
        row(kOfxParamPropPluginMayWrite, flag(0)),
        row(kOfxParamPropCanUndo, flag(1)),
        row(kOfxParamPropCacheInvalidation, Prop::text(kOfxParamInvalidateValueChange).one_of(CACHES)),
    ]
}

fn kind_rows(kind: &str) -> Vec<Row> {
    let flag = |value| Prop::ints(&[value]).writable();
    let bounds = |count: usize, int: bool| {
        let limit = |low: bool| match (int, low) {
            (true, true) => Prop::ints(&vec![i32::MIN; count]).writable(),
            (true, false) => Prop::ints(&vec![i32::MAX; count]).writable(),
            (false, true) => Prop::doubles(&vec![-f64::MAX; count]).writable(),
            (false, false) => Prop::doubles(&vec![f64::MAX; count]).writable(),
        };
        let names = [kOfxParamPropMin, kOfxParamPropMax, kOfxParamPropDisplayMin, kOfxParamPropDisplayMax];
        names.into_iter().enumerate().map(|(at, name)| row(name, limit(at % 2 == 0))).collect::<Vec<_>>()
    };
    let (value, count) = shape(kind);
    let mut rows = match kind {
        "OfxParamTypeChoice" => vec![
            row(kOfxParamPropChoiceOption, Prop::list(Type::Text)),
            row(kOfxParamPropChoiceOrder, Prop::list(Type::Int)),
        ],
        "OfxParamTypeString" => vec![
            row(kOfxParamPropStringMode, Prop::text(kOfxParamStringIsSingleLine).one_of(STRING_MODES)),
            row(kOfxParamPropStringFilePathExists, flag(1)),
        ],
        "OfxParamTypeCustom" => vec![row(kOfxParamPropCustomInterpCallbackV1, Prop::pointer(0).writable())],
        "OfxParamTypeGroup" => vec![row(kOfxParamPropGroupOpen, flag(1))],
        "OfxParamTypePage" => vec![row(kOfxParamPropPageChild, Prop::list(Type::Text))],
        "OfxParamTypeBoolean" | "OfxParamTypePushButton" => Vec::new(),
        _ => bounds(count, value == Type::Int),
    };
    if value == Type::Double && count > 0 {
        rows.push(row(kOfxParamPropIncrement, Prop::doubles(&[1.0]).writable()));
        rows.push(row(kOfxParamPropDigits, flag(2)));
        rows.push(row(kOfxParamPropDoubleType, Prop::text(kOfxParamDoubleTypePlain).one_of(DOUBLE_TYPES)));
        let system = Prop::text(kOfxParamCoordinatesCanonical).one_of(COORDINATES);
        rows.push(row(kOfxParamPropDefaultCoordinateSystem, system));
        rows.push(row(kOfxParamPropShowTimeMarker, flag(0)));
    }
    if count > 1 {
        let axes = if kind.contains("RGB") { ["r", "g", "b", "a"] } else { ["x", "y", "z", "w"] };
        rows.push(row(kOfxParamPropDimensionLabel, Prop::texts(&axes[..count]).writable()));
    }
    rows.push(row(kOfxParamPropUseHostOverlayHandle, flag(0)));
    rows.push(row(kOfxParamPropHasHostOverlayHandle, Prop::ints(&[0])));
    rows
}

/// A text as the value of a parameter.
pub fn text_value(text: &str) -> Vec<Value> {
    vec![Value::Text(CString::new(text).unwrap_or_default())]
}
