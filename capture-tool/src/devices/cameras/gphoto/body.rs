//! What a camera can be asked, whoever carries the question: libgphoto2 to real cameras, a script in tests.

use std::time::Duration;

/// A setting's value.
#[derive(Debug, Clone, PartialEq)]
pub enum Value {
    /// One of a list, or free text.
    Text(String),
    /// A slider's.
    Number(f32),
    /// On or off.
    Switch(bool),
}

/// A setting of a camera, or something it tells about itself.
#[derive(Debug, Clone, PartialEq)]
pub struct Widget {
    /// As libgphoto2 calls it, as in "shutterspeed".
    pub name: String,
    /// For people, as in "Shutter Speed".
    pub label: String,
    /// The camera does not let it be set now: its dials rule.
    pub readonly: bool,
    /// Now.
    pub value: Value,
    /// What it can be; empty for free text, sliders and switches.
    pub choices: Vec<String>,
}

/// Where a file lies on a camera.
#[derive(Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Place {
    /// As in "/store_00010001/DCIM/100NIKON".
    pub folder: String,
    /// As in "DSC_0001.NEF".
    pub name: String,
}

/// What a camera says by itself.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Event {
    /// Nothing, for as long as was waited.
    Quiet,
    /// A file was stored.
    Stored(Place),
    /// All files of the exposure are stored.
    Complete,
    /// Something else: a dial was turned, a folder was made.
    Other,
}

/// A card, or the camera's own memory.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Storage {
    /// For people.
    pub label: String,
    /// Free bytes, where the camera says so.
    pub free_bytes: Option<u64>,
    /// How many photographs fit, as the camera guesses.
    pub free_photographs: Option<u64>,
}

/// What came in place of an answer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Refusal {
    /// libgphoto2's number for it: negative.
    pub code: i32,
    /// As in "taking a photograph".
    pub doing: String,
    /// What the library says of it.
    pub said: String,
}

/// A connected camera. Calls block.
pub trait Body {
    /// All settings.
    fn widgets(&mut self) -> Result<Vec<Widget>, Refusal>;

    /// One setting, as it is now.
    fn widget(&mut self, name: &str) -> Result<Widget, Refusal>;

    /// Changes a setting. That it does not fail does not mean that the camera took the value.
    fn set(&mut self, name: &str, value: &Value) -> Result<(), Refusal>;

    /// Opens the shutter; returns after it has closed, with the first file.
    fn capture(&mut self) -> Result<Place, Refusal>;

    /// What the camera says next, within a time.
    fn event(&mut self, wait: Duration) -> Result<Event, Refusal>;

    /// Bytes of a file, where the camera says so.
    fn size(&mut self, place: &Place) -> Result<Option<u64>, Refusal>;

    /// A file.
    fn fetch(&mut self, place: &Place) -> Result<Vec<u8>, Refusal>;

    /// Removes a file from the camera.
    fn delete(&mut self, place: &Place) -> Result<(), Refusal>;

    /// Cards and memories.
    fn storages(&mut self) -> Result<Vec<Storage>, Refusal>;
}

impl Value {
    /// As the camera shows it.
    pub fn words(&self) -> String {
        match self {
            Self::Text(text) => text.clone(),
            Self::Number(number) => number.to_string(),
            Self::Switch(on) => if *on { "on" } else { "off" }.to_owned(),
        }
    }
}
