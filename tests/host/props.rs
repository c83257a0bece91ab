//! Property sets: names, types, dimensions and who may write, checked at every access.

use std::collections::{BTreeMap, BTreeSet};
use std::ffi::{CStr, CString};
use std::sync::{Arc, Mutex, Weak};

use super::log::Rule;
use super::ofx::*;
use super::registry::{Object, register, retire};
use super::shared::{Shared, blame, lock};

/// One element of a property.
#[derive(Debug, Clone, PartialEq)]
pub enum Value {
    Pointer(usize),
    Text(CString),
    Double(f64),
    Int(i32),
}

/// The type of a property.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Type {
    Pointer,
    Text,
    Double,
    Int,
}

impl Value {
    /// Its type.
    pub fn kind(&self) -> Type {
        match self {
            Self::Pointer(_) => Type::Pointer,
            Self::Text(_) => Type::Text,
            Self::Double(_) => Type::Double,
            Self::Int(_) => Type::Int,
        }
    }
}

/// A property: its definition and its value.
#[derive(Debug, Clone)]
pub struct Prop {
    pub kind: Type,
    /// Fixed dimension, or `None` for as many as the plugin sets.
    pub dimension: Option<usize>,
    pub values: Vec<Value>,
    pub default: Vec<Value>,
    /// Whether the plugin may set it.
    pub writable: bool,
    /// Which elements the plugin has set.
    pub set: BTreeSet<usize>,
    /// The host pretends not to know it.
    pub hidden: bool,
    /// Legal texts; empty for any.
    pub legal: &'static [&'static CStr],
}

impl Prop {
    fn fixed(kind: Type, values: Vec<Value>) -> Self {
        Self {
            kind,
            dimension: Some(values.len()),
            default: values.clone(),
            values,
            writable: false,
            set: BTreeSet::new(),
            hidden: false,
            legal: &[],
        }
    }

    /// Texts, as many as given.
    pub fn texts<S: AsRef<str>>(values: &[S]) -> Self {
        Self::fixed(Type::Text, values.iter().map(|text| Value::Text(c_string(text.as_ref()))).collect())
    }

    /// One text.
    pub fn text(value: &CStr) -> Self {
        Self::fixed(Type::Text, vec![Value::Text(value.to_owned())])
    }

    /// Whole numbers.
    pub fn ints(values: &[i32]) -> Self {
        Self::fixed(Type::Int, values.iter().copied().map(Value::Int).collect())
    }

    /// Numbers.
    pub fn doubles(values: &[f64]) -> Self {
        Self::fixed(Type::Double, values.iter().copied().map(Value::Double).collect())
    }

    /// A pointer.
    pub fn pointer(value: usize) -> Self {
        Self::fixed(Type::Pointer, vec![Value::Pointer(value)])
    }

    /// An empty list of any length, for the plugin to fill.
    pub fn list(kind: Type) -> Self {
        Self { dimension: None, writable: true, ..Self::fixed(kind, Vec::new()) }
    }

    /// Any length, read-only as it stands.
    pub fn any_length(self) -> Self {
        Self { dimension: None, ..self }
    }

    /// The plugin may set it.
    pub fn writable(self) -> Self {
        Self { writable: true, ..self }
    }

    /// The plugin may set it to these only.
    pub fn one_of(self, legal: &'static [&'static CStr]) -> Self {
        Self { writable: true, legal, ..self }
    }
}

/// Name and property: a row of a schema.
pub type Row = (String, Prop);

/// A set of properties with its handle.
pub struct PropertySet {
    /// What it describes, for messages.
    pub label: String,
    handle: Mutex<usize>,
    shared: Weak<Shared>,
    props: Mutex<BTreeMap<String, Prop>>,
}

impl PropertySet {
    /// A set without a handle of its own (images).
    pub fn bare(shared: &Arc<Shared>, label: impl Into<String>, rows: Vec<Row>) -> Arc<Self> {
        let props = Mutex::new(rows.into_iter().collect());
        Arc::new(Self { label: label.into(), handle: Mutex::new(0), shared: Arc::downgrade(shared), props })
    }

    /// A set with a handle.
    pub fn new(shared: &Arc<Shared>, label: impl Into<String>, rows: Vec<Row>) -> Arc<Self> {
        let set = Self::bare(shared, label, rows);
        *lock(&set.handle) = register(shared, Object::Props(Arc::clone(&set)));
        set
    }

    /// The handle to give to plugins.
    pub fn handle(&self) -> OfxPropertySetHandle {
        *lock(&self.handle) as OfxPropertySetHandle
    }

    /// Takes the handle back.
    pub fn close(&self) {
        retire(*lock(&self.handle));
    }

    /// The host it belongs to, while that lives.
    pub fn owner(&self) -> Option<Arc<Shared>> {
        self.shared.upgrade()
    }

    fn violate(&self, rule: Rule, what: String) {
        match self.shared.upgrade() {
            Some(shared) => shared.violate(rule, format!("{what} ({})", self.label)),
            None => blame(rule, what),
        }
    }

    /// A copy of a property.
    pub fn get(&self, name: &CStr) -> Option<Prop> {
        self.get_named(&super::ofx::name(name))
    }

    /// A copy of a property by its name as text.
    pub fn get_named(&self, name: &str) -> Option<Prop> {
        lock(&self.props).get(name).cloned()
    }

    /// The texts of a property; none when absent.
    pub fn texts(&self, name: &CStr) -> Vec<String> {
        let values = self.get(name).map(|prop| prop.values).unwrap_or_default();
        let text = |value| if let Value::Text(text) = value { Some(text.to_string_lossy().into_owned()) } else { None };
        values.into_iter().filter_map(text).collect()
    }

    /// Its first text; empty when absent.
    pub fn text(&self, name: &CStr) -> String {
        self.texts(name).into_iter().next().unwrap_or_default()
    }

    /// The numbers of a property, whole or not.
    pub fn numbers(&self, name: &CStr) -> Vec<f64> {
        self.numbers_named(&super::ofx::name(name))
    }

    /// As [`Self::numbers`], by the name as text.
    pub fn numbers_named(&self, name: &str) -> Vec<f64> {
        let number = |value| match value {
            Value::Double(value) => Some(value),
            Value::Int(value) => Some(f64::from(value)),
            _ => None,
        };
        let values = self.get_named(name).map(|prop| prop.values).unwrap_or_default();
        values.into_iter().filter_map(number).collect()
    }

    /// Replaces or adds a property, as the host.
    pub fn put(&self, name: &CStr, prop: Prop) {
        lock(&self.props).insert(super::ofx::name(name), prop);
    }

    /// Hides a property from the plugin, or shows it again.
    pub fn hide(&self, name: &CStr, hidden: bool) {
        if let Some(prop) = lock(&self.props).get_mut(&super::ofx::name(name)) {
            prop.hidden = hidden;
        }
    }

    /// All properties, for an instance to start from.
    pub fn rows(&self) -> Vec<Row> {
        lock(&self.props).iter().map(|(name, prop)| (name.clone(), prop.clone())).collect()
    }

    fn access<T>(
        &self,
        call: &str,
        name: &str,
        work: impl FnOnce(&mut Prop) -> Result<T, Fault>,
    ) -> Result<T, OfxStatus> {
        let outcome = match lock(&self.props).get_mut(name) {
            Some(prop) if prop.hidden => return Err(kOfxStatErrUnknown),
            Some(prop) => work(prop),
            None if is_optional(name) => return Err(kOfxStatErrUnknown),
            None => Err((Rule::UnknownName, "there is no such property here".into(), kOfxStatErrUnknown)),
        };
        outcome.map_err(|(rule, what, status)| {
            self.violate(rule, format!("{call} of {name}: {what}"));
            status
        })
    }

    /// As the plugin: sets elements `from..`. With `whole` the count must be the dimension.
    pub fn set(&self, call: &str, name: &str, from: i32, values: Vec<Value>, whole: bool) -> OfxStatus {
        let done = self.access(call, name, |prop| {
            let from = usize::try_from(from).map_err(|_| bad_index(from, prop))?;
            check_set(prop, from, &values, whole)?;
            if whole && prop.dimension.is_none() {
                prop.values.clear();
            }
            prop.set.extend(from..from + values.len());
            for (at, value) in values.into_iter().enumerate() {
                match prop.values.get_mut(from + at) {
                    Some(slot) => *slot = value,
                    None => prop.values.push(value),
                }
            }
            Ok(())
        });
        done.map_or_else(|status| status, |()| kOfxStatOK)
    }

    /// As the plugin: reads `count` elements from `from`.
    pub fn read(&self, call: &str, name: &str, from: i32, count: i32, kind: Type) -> Result<Vec<Value>, OfxStatus> {
        self.access(call, name, |prop| {
            if prop.kind != kind {
                return Err((Rule::WrongType, format!("read as {kind:?}, is {:?}", prop.kind), kOfxStatErrValue));
            }
            let range = usize::try_from(from).ok().zip(usize::try_from(count).ok()).map(|(a, n)| a..a + n);
            let values = range.and_then(|range| prop.values.get(range));
            values.map(<[Value]>::to_vec).ok_or_else(|| bad_index(from + count - 1, prop))
        })
    }

    /// As the plugin: back to the default.
    pub fn reset(&self, name: &str) -> OfxStatus {
        let done = self.access("propReset", name, |prop| {
            if !prop.writable {
                return Err((Rule::ReadOnly, "it is the host's to write".into(), kOfxStatErrValue));
            }
            prop.values = prop.default.clone();
            prop.set.clear();
            Ok(())
        });
        done.map_or_else(|status| status, |()| kOfxStatOK)
    }

    /// As the plugin: how many elements.
    pub fn dimension(&self, name: &str) -> Result<i32, OfxStatus> {
        self.access("propGetDimension", name, |prop| Ok(i32::try_from(prop.values.len()).unwrap_or(i32::MAX)))
    }
}

type Fault = (Rule, String, OfxStatus);

fn bad_index(index: i32, prop: &Prop) -> Fault {
    (Rule::WrongDimension, format!("element {index} of {}", prop.values.len()), kOfxStatErrBadIndex)
}

fn check_set(prop: &Prop, from: usize, values: &[Value], whole: bool) -> Result<(), Fault> {
    if let Some(value) = values.iter().find(|value| value.kind() != prop.kind) {
        return Err((Rule::WrongType, format!("set as {:?}, is {:?}", value.kind(), prop.kind), kOfxStatErrValue));
    }
    if !prop.writable {
        return Err((Rule::ReadOnly, "it is the host's to write".into(), kOfxStatErrValue));
    }
    let end = from + values.len();
    let fits = match prop.dimension {
        Some(dimension) if whole => end == dimension,
        Some(dimension) => end <= dimension,
        None => from <= prop.values.len(),
    };
    if !fits {
        let found = format!("elements {from}..{end} of {}", prop.dimension.unwrap_or(prop.values.len()));
        return Err((Rule::WrongDimension, found, kOfxStatErrBadIndex));
    }
    let illegal = |value: &&Value| matches!(value, Value::Text(text) if !prop.legal.contains(&text.as_c_str()));
    if let Some(value) = values.iter().find(illegal).filter(|_| !prop.legal.is_empty()) {
        return Err((Rule::BadValue, format!("{value:?} is none of {:?}", prop.legal), kOfxStatErrValue));
    }
    if values.iter().any(|value| matches!(value, Value::Double(number) if number.is_nan())) {
        return Err((Rule::BadValue, "not a number".into(), kOfxStatErrValue));
    }
    Ok(())
}

/// Properties of the standard's optional parts (GPU, colour management) and of well-known extensions: a plugin may ask,
/// and is told politely that this host has them not.
fn is_optional(name: &str) -> bool {
    const PARTS: [&str; 12] = [
        "OpenGL",
        "OpenCL",
        "Cuda",
        "Metal",
        "CPURender",
        "Colourspace",
        "ColourManagement",
        "OCIO",
        "Natron",
        "uk.co.thefoundry",
        "Resolve",
        "OfxImageEffectPropThumbnailRender",
    ];
    PARTS.iter().any(|part| name.contains(part))
}
