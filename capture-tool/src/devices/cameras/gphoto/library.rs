//! libgphoto2, opened when the tool runs: nothing is needed to build against, and machines without it lose cameras over USB
//! alone. The one file of this tool that calls foreign code.
//!
//! Signatures and layouts are those of the headers of libgphoto2 2.5 (`gphoto2/gphoto2-*.h`), whose binary interface the number
//! in the library's name (6) stands for. Every handle is owned by a guard before the next call, so that no path leaks; the library itself
//! is never closed again, for its camera drivers stay registered with the system's loader.

#![allow(unsafe_code)]

use std::ffi::{CStr, CString, c_char, c_float, c_int, c_void};
use std::fmt;
use std::ptr::{null, null_mut};
use std::sync::{Mutex, OnceLock, PoisonError};
use std::time::Duration;

use super::body::{Body, Event, Place, Refusal, Storage, Value, Widget};

/// Where the library is looked for: by its name alone as the system does, then where Homebrew puts it.
#[cfg(target_os = "macos")]
const NAMES: &[&str] =
    &["libgphoto2.6.dylib", "/opt/homebrew/lib/libgphoto2.6.dylib", "/usr/local/lib/libgphoto2.6.dylib"];
/// There is none for Windows.
#[cfg(windows)]
const NAMES: &[&str] = &[];
/// Where the library is looked for.
#[cfg(not(any(windows, target_os = "macos")))]
const NAMES: &[&str] = &["libgphoto2.so.6"];

type Handle = *mut c_void;
type Text = *const c_char;

/// Declares the table of functions, with a way to look all of them up by their names.
macro_rules! functions {
    ($($name:ident($($argument:ty),*) -> $returns:ty;)*) => {
        /// The functions that are used.
        struct Functions {
            $($name: unsafe extern "C" fn($($argument),*) -> $returns,)*
        }

        /// Their names.
        #[cfg(test)]
        const SYMBOLS: &[&str] = &[$(stringify!($name)),*];

        impl Functions {
            /// Looks every one up; else the name of the first that is missing.
            fn find(look_up: &dyn Fn(&'static str) -> Option<Handle>) -> Result<Self, &'static str> {
                Ok(Self {$(
                    $name: {
                        let found = look_up(stringify!($name)).filter(|found| !found.is_null());
                        let found = found.ok_or(stringify!($name))?;
                        // SAFETY: the symbol of this name is a function with this signature, by the library's header; a
                        // pointer to it was just found not to be null, and is as large as a pointer to a function.
                        unsafe { std::mem::transmute::<Handle, unsafe extern "C" fn($($argument),*) -> $returns>(found) }
                    },
                )*})
            }
        }
    };
}

functions! {
    gp_library_version(c_int) -> *const Text;
    gp_result_as_string(c_int) -> Text;
    gp_context_new() -> Handle;
    gp_context_unref(Handle) -> ();
    gp_context_set_error_func(Handle, Hear, Handle) -> ();
    gp_list_new(*mut Handle) -> c_int;
    gp_list_free(Handle) -> c_int;
    gp_list_count(Handle) -> c_int;
    gp_list_get_name(Handle, c_int, *mut Text) -> c_int;
    gp_list_get_value(Handle, c_int, *mut Text) -> c_int;
    gp_port_info_list_new(*mut Handle) -> c_int;
    gp_port_info_list_free(Handle) -> c_int;
    gp_port_info_list_load(Handle) -> c_int;
    gp_port_info_list_lookup_path(Handle, Text) -> c_int;
    gp_port_info_list_get_info(Handle, c_int, *mut Handle) -> c_int;
    gp_camera_autodetect(Handle, Handle) -> c_int;
    gp_camera_new(*mut Handle) -> c_int;
    gp_camera_set_port_info(Handle, Handle) -> c_int;
    gp_camera_init(Handle, Handle) -> c_int;
    gp_camera_exit(Handle, Handle) -> c_int;
    gp_camera_unref(Handle) -> c_int;
    gp_camera_get_config(Handle, *mut Handle, Handle) -> c_int;
    gp_camera_get_single_config(Handle, Text, *mut Handle, Handle) -> c_int;
    gp_camera_set_single_config(Handle, Text, Handle, Handle) -> c_int;
    gp_widget_free(Handle) -> c_int;
    gp_widget_count_children(Handle) -> c_int;
    gp_widget_get_child(Handle, c_int, *mut Handle) -> c_int;
    gp_widget_get_name(Handle, *mut Text) -> c_int;
    gp_widget_get_label(Handle, *mut Text) -> c_int;
    gp_widget_get_type(Handle, *mut c_int) -> c_int;
    gp_widget_get_readonly(Handle, *mut c_int) -> c_int;
    gp_widget_get_value(Handle, Handle) -> c_int;
    gp_widget_set_value(Handle, *const c_void) -> c_int;
    gp_widget_count_choices(Handle) -> c_int;
    gp_widget_get_choice(Handle, c_int, *mut Text) -> c_int;
    gp_camera_capture(Handle, c_int, *mut FilePath, Handle) -> c_int;
    gp_camera_wait_for_event(Handle, c_int, *mut c_int, *mut Handle, Handle) -> c_int;
    gp_camera_file_get_info(Handle, Text, Text, *mut FileInfo, Handle) -> c_int;
    gp_file_new(*mut Handle) -> c_int;
    gp_file_unref(Handle) -> c_int;
    gp_camera_file_get(Handle, Text, Text, c_int, Handle, Handle) -> c_int;
    gp_file_get_data_and_size(Handle, *mut Text, *mut u64Long) -> c_int;
    gp_camera_file_delete(Handle, Text, Text, Handle) -> c_int;
    gp_camera_get_storageinfo(Handle, *mut *mut StorageInfo, *mut c_int, Handle) -> c_int;
}

/// `unsigned long`.
#[allow(non_camel_case_types)]
type u64Long = std::ffi::c_ulong;
/// `GPContextErrorFunc`.
type Hear = Option<unsafe extern "C" fn(Handle, Text, Handle)>;

/// `CameraWidgetType`.
const WIDGET_TEXT: c_int = 2;
const WIDGET_RANGE: c_int = 3;
const WIDGET_TOGGLE: c_int = 4;
const WIDGET_RADIO: c_int = 5;
const WIDGET_MENU: c_int = 6;
/// `GP_CAPTURE_IMAGE`.
const CAPTURE_IMAGE: c_int = 0;
/// `CameraEventType`.
const EVENT_TIMEOUT: c_int = 1;
const EVENT_FILE_ADDED: c_int = 2;
const EVENT_CAPTURE_COMPLETE: c_int = 4;
/// `GP_FILE_TYPE_NORMAL`.
const FILE_NORMAL: c_int = 1;
/// `GP_FILE_INFO_SIZE`.
const INFO_SIZE: c_int = 1 << 2;
/// `GP_STORAGEINFO_LABEL`, `_FREESPACEKBYTES`, `_FREESPACEIMAGES`.
const STORAGE_LABEL: c_int = 1 << 1;
const STORAGE_FREE_KB: c_int = 1 << 7;
const STORAGE_FREE_IMAGES: c_int = 1 << 8;
/// `GP_VERSION_SHORT`.
const VERSION_SHORT: c_int = 0;

/// `CameraFilePath`.
#[repr(C)]
struct FilePath {
    name: [c_char; 128],
    folder: [c_char; 1024],
}

/// `CameraFileInfo`: what it says of the preview, the file and the sound.
#[repr(C)]
struct FileInfo {
    preview: PreviewInfo,
    fields: c_int,
    status: c_int,
    size: u64,
    kind: [c_char; 64],
    width: u32,
    height: u32,
    permissions: c_int,
    // `time_t`.
    modified: std::ffi::c_long,
    sound_fields: c_int,
    sound_status: c_int,
    sound_size: u64,
    sound_kind: [c_char; 64],
}

/// `CameraFileInfoPreview`.
#[repr(C)]
struct PreviewInfo {
    fields: c_int,
    status: c_int,
    size: u64,
    kind: [c_char; 64],
    width: u32,
    height: u32,
}

/// `CameraStorageInformation`.
#[repr(C)]
struct StorageInfo {
    fields: c_int,
    base: [c_char; 256],
    label: [c_char; 256],
    description: [c_char; 256],
    kind: c_int,
    file_system: c_int,
    access: c_int,
    capacity_kb: u64,
    free_kb: u64,
    free_images: u64,
}

unsafe extern "C" {
    /// Of the C library, with which libgphoto2 allocates what its callers are to free.
    fn free(memory: Handle);
}

/// Why the library cannot be used.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Absent {
    /// Of systems that it is not made for.
    System,
    /// It was not found, or does not load.
    Library {
        /// Its name.
        name: String,
        /// What the system's loader says.
        said: String,
    },
    /// It is of another kind than it should be.
    Symbol {
        /// The library's name.
        name: String,
        /// The first function that is missing.
        symbol: &'static str,
    },
}

impl Absent {
    /// What to do about it.
    pub fn advice(&self) -> &'static str {
        match self {
            Self::Library { .. } if cfg!(target_os = "macos") => {
                "install it (brew install libgphoto2), or set driver = \"folder\" for the camera in the rig file"
            }
            Self::Library { .. } => {
                "install it (apt install libgphoto2-6, dnf install libgphoto2), or set driver = \"folder\" for the camera in \
                 the rig file"
            }
            Self::Symbol { .. } => {
                "install libgphoto2 2.5.10 or newer, or set driver = \"folder\" for the camera in the rig file"
            }
            Self::System => {
                "set driver = \"folder\" for the camera in the rig file, and let the maker's software put photographs there"
            }
        }
    }
}

impl fmt::Display for Absent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::System => write!(f, "there is no libgphoto2 on this system, which drives cameras over USB"),
            Self::Library { name, said } => {
                write!(f, "the library {name}, which drives cameras over USB, cannot be opened ({said})")
            }
            Self::Symbol { name, symbol } => {
                write!(f, "the library {name}, which drives cameras over USB, has no function {symbol}")
            }
        }
    }
}

/// The library.
pub struct Gphoto {
    functions: Functions,
    /// Keeps what the table points to.
    _library: libloading::Library,
}

impl Gphoto {
    /// The library of this machine, opened at the first call.
    ///
    /// # Errors
    /// It is not there, or not the right one.
    pub fn open() -> Result<&'static Self, Absent> {
        static OPENED: OnceLock<Result<Gphoto, Absent>> = OnceLock::new();
        OPENED.get_or_init(|| Self::load(NAMES)).as_ref().map_err(Clone::clone)
    }

    /// The first of these names that can be opened.
    fn load(names: &[&str]) -> Result<Self, Absent> {
        let mut absent = Absent::System;
        for name in names {
            // SAFETY: loading runs the library's own initialisation: libgphoto2 has none but its translations'.
            match unsafe { libloading::Library::new(*name) } {
                Ok(library) => return Self::of(name, library),
                Err(error) if matches!(absent, Absent::System) => {
                    absent = Absent::Library { name: (*name).to_owned(), said: error.to_string() };
                }
                Err(_) => {}
            }
        }
        Err(absent)
    }

    fn of(name: &str, library: libloading::Library) -> Result<Self, Absent> {
        let look_up = |symbol: &'static str| {
            // SAFETY: the symbol is not used here but as an address.
            unsafe { library.get::<Handle>(symbol).ok().and_then(|found| found.try_as_raw_ptr()) }
        };
        let functions = Functions::find(&look_up);
        let functions = functions.map_err(|symbol| Absent::Symbol { name: name.to_owned(), symbol })?;
        Ok(Self { functions, _library: library })
    }

    /// As in "2.5.30".
    pub fn version(&self) -> String {
        // SAFETY: the library returns a list of texts of its own, the first of which is its version.
        unsafe {
            let lines = (self.functions.gp_library_version)(VERSION_SHORT);
            if lines.is_null() { String::new() } else { text(*lines) }
        }
    }

    /// Model and port of every connected camera.
    ///
    /// # Errors
    /// What the library says of the ports.
    pub fn cameras(&'static self) -> Result<Vec<(String, String)>, Refusal> {
        let f = &self.functions;
        let context = Context::new(self);
        let list = Owned::new(self, f.gp_list_new, f.gp_list_free, "looking for cameras")?;
        // SAFETY: handles that their guards keep alive.
        let code = unsafe { (f.gp_camera_autodetect)(list.handle, context.handle) };
        context.check(code, "looking for cameras")?;
        // SAFETY: as before.
        let count = unsafe { (f.gp_list_count)(list.handle) };
        let entry = |n, get: unsafe extern "C" fn(Handle, c_int, *mut Text) -> c_int| {
            let mut found = null();
            // SAFETY: the list lives, and keeps the text while it does.
            unsafe { if get(list.handle, n, &mut found) < 0 { String::new() } else { text(found) } }
        };
        Ok((0..count).map(|n| (entry(n, f.gp_list_get_name), entry(n, f.gp_list_get_value))).collect())
    }

    /// The camera at a port, as [`Gphoto::cameras`] names it.
    ///
    /// # Errors
    /// No camera there, one that another program holds, one that does not answer.
    pub fn connect(&'static self, port: &str) -> Result<Device, Refusal> {
        const DOING: &str = "connecting";
        let f = &self.functions;
        let context = Context::new(self);
        let camera = Owned::new(self, f.gp_camera_new, f.gp_camera_unref, DOING)?;
        let ports = Owned::new(self, f.gp_port_info_list_new, f.gp_port_info_list_free, DOING)?;
        let path = c_text(port);
        let mut info = null_mut();
        // SAFETY: handles that their guards keep alive; the port's information belongs to the list, and the camera copies it.
        unsafe {
            context.check((f.gp_port_info_list_load)(ports.handle), DOING)?;
            let at = context.check((f.gp_port_info_list_lookup_path)(ports.handle, path.as_ptr()), DOING)?;
            context.check((f.gp_port_info_list_get_info)(ports.handle, at, &mut info), DOING)?;
            context.check((f.gp_camera_set_port_info)(camera.handle, info), DOING)?;
            context.check((f.gp_camera_init)(camera.handle, context.handle), DOING)?;
        }
        Ok(Device { camera, context })
    }
}

/// A handle, and what frees it.
struct Owned {
    handle: Handle,
    free: unsafe extern "C" fn(Handle) -> c_int,
}

impl Owned {
    /// Made by one of the library's functions that make handles.
    fn new(
        gphoto: &Gphoto,
        make: unsafe extern "C" fn(*mut Handle) -> c_int,
        free: unsafe extern "C" fn(Handle) -> c_int,
        doing: &str,
    ) -> Result<Self, Refusal> {
        let mut handle = null_mut();
        // SAFETY: the function writes a handle that its caller owns.
        let code = unsafe { make(&mut handle) };
        if code < 0 || handle.is_null() {
            return Err(gphoto.refusal(code.min(-1), doing, None));
        }
        Ok(Self { handle, free })
    }
}

impl Drop for Owned {
    fn drop(&mut self) {
        // SAFETY: the handle is owned, and nothing uses it after.
        unsafe { (self.free)(self.handle) };
    }
}

/// Carries a call, and what drivers say about it.
struct Context {
    gphoto: &'static Gphoto,
    handle: Handle,
    /// Boxed: the library keeps its address.
    heard: Box<Mutex<String>>,
}

impl Context {
    fn new(gphoto: &'static Gphoto) -> Self {
        let heard = Box::new(Mutex::new(String::new()));
        // SAFETY: the context lives as long as the box whose address it keeps: both are dropped together.
        let handle = unsafe {
            let handle = (gphoto.functions.gp_context_new)();
            (gphoto.functions.gp_context_set_error_func)(handle, Some(hear), (&raw const *heard).cast_mut().cast());
            handle
        };
        Self { gphoto, handle, heard }
    }

    /// The code itself where it is none of an error.
    fn check(&self, code: c_int, doing: &str) -> Result<c_int, Refusal> {
        let heard = std::mem::take(&mut *self.heard.lock().unwrap_or_else(PoisonError::into_inner));
        if code >= 0 {
            return Ok(code);
        }
        Err(self.gphoto.refusal(code, doing, Some(heard)))
    }
}

impl Drop for Context {
    fn drop(&mut self) {
        // SAFETY: made by `gp_context_new`, and not used after.
        unsafe { (self.gphoto.functions.gp_context_unref)(self.handle) };
    }
}

/// The library tells what went wrong.
unsafe extern "C" fn hear(_context: Handle, said: Text, into: Handle) {
    // SAFETY: `into` is what `Context::new` gave, which lives while its context does; `said` is a text or null.
    unsafe {
        let into = &*into.cast::<Mutex<String>>();
        *into.lock().unwrap_or_else(PoisonError::into_inner) = text(said);
    }
}

impl Gphoto {
    fn refusal(&self, code: c_int, doing: &str, heard: Option<String>) -> Refusal {
        // SAFETY: the library returns a text of its own for any number.
        let general = unsafe { text((self.functions.gp_result_as_string)(code)) };
        let said = heard.map(|heard| heard.trim().trim_end_matches('.').to_owned()).filter(|heard| !heard.is_empty());
        Refusal { code, doing: doing.to_owned(), said: said.unwrap_or(general) }
    }
}

/// A connected camera. The context outlives it: fields are dropped in this order.
pub struct Device {
    camera: Owned,
    context: Context,
}

impl Drop for Device {
    fn drop(&mut self) {
        // SAFETY: both live until after this; the camera is let go for other programs.
        unsafe { (self.functions().gp_camera_exit)(self.camera.handle, self.context.handle) };
    }
}

impl Device {
    fn functions(&self) -> &'static Functions {
        &self.context.gphoto.functions
    }

    fn refuse<T>(&self, code: c_int, doing: &str) -> Result<T, Refusal> {
        Err(self.context.gphoto.refusal(code, doing, None))
    }

    /// A widget of the camera's, made anew at each call.
    fn config(&self, name: Option<&CStr>, doing: &str) -> Result<Owned, Refusal> {
        let f = self.functions();
        let mut handle = null_mut();
        // SAFETY: handles that their guards keep alive; the widget that is written belongs to its caller.
        let code = unsafe {
            match name {
                None => (f.gp_camera_get_config)(self.camera.handle, &mut handle, self.context.handle),
                Some(name) => {
                    (f.gp_camera_get_single_config)(self.camera.handle, name.as_ptr(), &mut handle, self.context.handle)
                }
            }
        };
        self.context.check(code, doing)?;
        if handle.is_null() { self.refuse(-1, doing) } else { Ok(Owned { handle, free: f.gp_widget_free }) }
    }

    fn kind(&self, widget: Handle) -> c_int {
        let mut kind = 0;
        // SAFETY: the caller's guard keeps the widget, or the tree that it is in, alive.
        unsafe { (self.functions().gp_widget_get_type)(widget, &mut kind) };
        kind
    }

    fn value(&self, widget: Handle) -> Option<Value> {
        let get = self.functions().gp_widget_get_value;
        match self.kind(widget) {
            WIDGET_TEXT | WIDGET_RADIO | WIDGET_MENU => {
                let mut found: Text = null();
                // SAFETY: widgets of these kinds write a pointer to a text of their own, which is copied at once.
                unsafe { (get(widget, (&raw mut found).cast()) >= 0).then(|| Value::Text(text(found))) }
            }
            WIDGET_RANGE => {
                let mut found: c_float = 0.0;
                // SAFETY: widgets of this kind write a float.
                unsafe { (get(widget, (&raw mut found).cast()) >= 0).then_some(Value::Number(found)) }
            }
            WIDGET_TOGGLE => {
                let mut found: c_int = 0;
                // SAFETY: widgets of this kind write an int.
                unsafe { (get(widget, (&raw mut found).cast()) >= 0).then_some(Value::Switch(found == 1)) }
            }
            _ => None,
        }
    }

    /// None for windows, sections, buttons and dates.
    fn read(&self, widget: Handle) -> Option<Widget> {
        let f = self.functions();
        let value = self.value(widget)?;
        let label = |get: unsafe extern "C" fn(Handle, *mut Text) -> c_int| {
            let mut found = null();
            // SAFETY: the widget keeps the text, which is copied at once.
            unsafe { if get(widget, &mut found) < 0 { String::new() } else { text(found) } }
        };
        let mut readonly = 0;
        // SAFETY: the widget is alive, as for all of its kind here.
        let count = unsafe {
            (f.gp_widget_get_readonly)(widget, &mut readonly);
            (f.gp_widget_count_choices)(widget)
        };
        let choice = |n| {
            let mut found = null();
            // SAFETY: as for labels.
            unsafe { ((f.gp_widget_get_choice)(widget, n, &mut found) >= 0).then(|| text(found)) }
        };
        Some(Widget {
            name: label(f.gp_widget_get_name),
            label: label(f.gp_widget_get_label),
            readonly: readonly != 0,
            value,
            choices: (0..count).filter_map(choice).collect(),
        })
    }

    /// Leaves of a tree, in its order.
    fn leaves(&self, widget: Handle, into: &mut Vec<Widget>) {
        let f = self.functions();
        into.extend(self.read(widget));
        // SAFETY: children belong to the tree, which the caller's guard keeps alive.
        let count = unsafe { (f.gp_widget_count_children)(widget) };
        for n in 0..count {
            let mut child = null_mut();
            // SAFETY: as before.
            if unsafe { (f.gp_widget_get_child)(widget, n, &mut child) } >= 0 && !child.is_null() {
                self.leaves(child, into);
            }
        }
    }

    /// Folder and name as the library takes them.
    fn names(place: &Place) -> (CString, CString) {
        (c_text(&place.folder), c_text(&place.name))
    }
}

impl Body for Device {
    fn widgets(&mut self) -> Result<Vec<Widget>, Refusal> {
        let tree = self.config(None, "reading its settings")?;
        let mut found = Vec::new();
        self.leaves(tree.handle, &mut found);
        Ok(found)
    }

    fn widget(&mut self, name: &str) -> Result<Widget, Refusal> {
        let doing = format!("reading its setting {name}");
        let widget = self.config(Some(&c_text(name)), &doing)?;
        self.read(widget.handle).map_or_else(|| self.refuse(-6, &doing), Ok)
    }

    fn set(&mut self, name: &str, value: &Value) -> Result<(), Refusal> {
        let doing = format!("setting {name} to {}", value.words());
        let (f, c_name) = (self.functions(), c_text(name));
        let widget = self.config(Some(&c_name), &doing)?;
        // SAFETY: each kind of widget reads what is pointed to here, a text, a float or an int, and copies it.
        let code = unsafe {
            match (self.kind(widget.handle), value) {
                (WIDGET_TEXT | WIDGET_RADIO | WIDGET_MENU, Value::Text(text)) => {
                    (f.gp_widget_set_value)(widget.handle, c_text(text).as_ptr().cast())
                }
                (WIDGET_RANGE, Value::Number(number)) => {
                    (f.gp_widget_set_value)(widget.handle, (&raw const *number).cast())
                }
                (WIDGET_TOGGLE, Value::Switch(on)) => {
                    let on = c_int::from(*on);
                    (f.gp_widget_set_value)(widget.handle, (&raw const on).cast())
                }
                _ => -6,
            }
        };
        self.context.check(code, &doing)?;
        // SAFETY: handles that their guards keep alive.
        let code = unsafe {
            (f.gp_camera_set_single_config)(self.camera.handle, c_name.as_ptr(), widget.handle, self.context.handle)
        };
        self.context.check(code, &doing).map(|_| ())
    }

    fn capture(&mut self) -> Result<Place, Refusal> {
        let mut path = FilePath { name: [0; 128], folder: [0; 1024] };
        // SAFETY: handles that their guards keep alive; the library fills in the two texts.
        let code = unsafe {
            (self.functions().gp_camera_capture)(self.camera.handle, CAPTURE_IMAGE, &mut path, self.context.handle)
        };
        self.context.check(code, "taking a photograph")?;
        Ok(path.place())
    }

    fn event(&mut self, wait: Duration) -> Result<Event, Refusal> {
        let wait = c_int::try_from(wait.as_millis()).unwrap_or(c_int::MAX);
        let (mut kind, mut data) = (EVENT_TIMEOUT, null_mut());
        // SAFETY: handles that their guards keep alive; what is written to `data` was allocated for the caller.
        let code = unsafe {
            (self.functions().gp_camera_wait_for_event)(
                self.camera.handle,
                wait,
                &mut kind,
                &mut data,
                self.context.handle,
            )
        };
        let data = Allocated(data);
        self.context.check(code, "waiting for what it says")?;
        Ok(match kind {
            EVENT_TIMEOUT => Event::Quiet,
            EVENT_CAPTURE_COMPLETE => Event::Complete,
            EVENT_FILE_ADDED if !data.0.is_null() => {
                // SAFETY: this kind of event comes with a file's path, which is copied before it is freed.
                Event::Stored(unsafe { (*data.0.cast::<FilePath>()).place() })
            }
            _ => Event::Other,
        })
    }

    fn size(&mut self, place: &Place) -> Result<Option<u64>, Refusal> {
        let (folder, name) = Self::names(place);
        // SAFETY: numbers and texts, of which all zeros are valid values.
        let mut info: FileInfo = unsafe { std::mem::zeroed() };
        // SAFETY: handles and texts live; the library fills in the information.
        let code = unsafe {
            let get = self.functions().gp_camera_file_get_info;
            get(self.camera.handle, folder.as_ptr(), name.as_ptr(), &mut info, self.context.handle)
        };
        self.context.check(code, &format!("asking for the size of {}", place.name))?;
        Ok((info.fields & INFO_SIZE != 0).then_some(info.size))
    }

    fn fetch(&mut self, place: &Place) -> Result<Vec<u8>, Refusal> {
        let doing = format!("downloading {}", place.name);
        let (folder, name) = Self::names(place);
        let f = self.functions();
        let file = Owned::new(self.context.gphoto, f.gp_file_new, f.gp_file_unref, &doing)?;
        let (camera, context) = (self.camera.handle, self.context.handle);
        // SAFETY: handles and texts live.
        let code = unsafe {
            (f.gp_camera_file_get)(camera, folder.as_ptr(), name.as_ptr(), FILE_NORMAL, file.handle, context)
        };
        self.context.check(code, &doing)?;
        let (mut data, mut size) = (null(), 0);
        // SAFETY: the file keeps its bytes until it is freed; they are copied before.
        unsafe {
            self.context.check((f.gp_file_get_data_and_size)(file.handle, &mut data, &mut size), &doing)?;
            let size = usize::try_from(size).unwrap_or(0);
            let nothing = data.is_null() || size == 0;
            Ok(if nothing { Vec::new() } else { std::slice::from_raw_parts(data.cast::<u8>(), size).to_vec() })
        }
    }

    fn delete(&mut self, place: &Place) -> Result<(), Refusal> {
        let (folder, name) = Self::names(place);
        let (camera, context) = (self.camera.handle, self.context.handle);
        // SAFETY: handles and texts live.
        let code = unsafe { (self.functions().gp_camera_file_delete)(camera, folder.as_ptr(), name.as_ptr(), context) };
        self.context.check(code, &format!("deleting {}", place.name)).map(|_| ())
    }

    fn storages(&mut self) -> Result<Vec<Storage>, Refusal> {
        let (mut found, mut count) = (null_mut(), 0);
        // SAFETY: handles that their guards keep alive; the list that is written was allocated for the caller.
        let code = unsafe {
            let get = self.functions().gp_camera_get_storageinfo;
            get(self.camera.handle, &mut found, &mut count, self.context.handle)
        };
        let list = Allocated(found.cast());
        self.context.check(code, "asking for the room on its card")?;
        if list.0.is_null() {
            return Ok(Vec::new());
        }
        // SAFETY: so many of them were written.
        let all = unsafe { std::slice::from_raw_parts(found, usize::try_from(count).unwrap_or(0)) };
        let known = |fields: c_int, field: c_int, value: u64| (fields & field != 0).then_some(value);
        Ok(all
            .iter()
            .map(|info| Storage {
                label: if info.fields & STORAGE_LABEL == 0 { String::new() } else { letters(&info.label) },
                free_bytes: known(info.fields, STORAGE_FREE_KB, info.free_kb.saturating_mul(1024)),
                free_photographs: known(info.fields, STORAGE_FREE_IMAGES, info.free_images),
            })
            .collect())
    }
}

/// What the library allocated for its caller.
struct Allocated(Handle);

impl Drop for Allocated {
    fn drop(&mut self) {
        // SAFETY: from `malloc`, or null; not used after.
        unsafe { free(self.0) };
    }
}

impl FilePath {
    fn place(&self) -> Place {
        Place { folder: letters(&self.folder), name: letters(&self.name) }
    }
}

/// A text of the library's; empty for null.
///
/// # Safety
/// Null, or the address of a text that ends with a zero and lives during the call.
unsafe fn text(found: Text) -> String {
    if found.is_null() {
        return String::new();
    }
    // SAFETY: by the function's contract.
    unsafe { CStr::from_ptr(found) }.to_string_lossy().into_owned()
}

/// A text in an array, up to its zero.
fn letters(array: &[c_char]) -> String {
    let bytes: Vec<u8> = array.iter().map(|c| c.cast_unsigned()).take_while(|c| *c != 0).collect();
    String::from_utf8_lossy(&bytes).into_owned()
}

/// A text for the library; what follows a zero inside is cut off.
fn c_text(text: &str) -> CString {
    let until = text.find('\0').unwrap_or(text.len());
    CString::new(&text[..until]).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use std::process::Command;

    use super::*;

    /// An address that is nothing's, and is never called.
    fn somewhere() -> Handle {
        std::ptr::without_provenance_mut(4096)
    }

    #[test]
    fn every_function_is_missed_by_its_name() {
        assert!(Functions::find(&|_| Some(somewhere())).is_ok());
        for missing in SYMBOLS {
            let found = Functions::find(&|name| (name != *missing).then(somewhere));
            assert_eq!(found.err(), Some(*missing));
            let found = Functions::find(&|name| Some(if name == *missing { null_mut() } else { somewhere() }));
            assert_eq!(found.err(), Some(*missing), "null");
        }
    }

    #[test]
    fn a_library_that_is_not_there_is_said() {
        let absent = Gphoto::load(&["libgphoto2-that-is-not-there.so.6", "neither.so"]).err().unwrap();
        let said = absent.to_string();
        assert!(said.contains("libgphoto2-that-is-not-there.so.6") && said.contains("cannot be opened"), "{said}");
        assert!(absent.advice().contains("install") && absent.advice().contains("driver = \"folder\""));
        let absent = Gphoto::load(&[]).err().unwrap();
        assert_eq!(absent, Absent::System);
        assert!(absent.advice().contains("folder"));
        // A file that is no library.
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("libgphoto2.so.6");
        std::fs::write(&file, "no library").unwrap();
        let absent = Gphoto::load(&[file.to_str().unwrap()]).err().unwrap();
        assert!(matches!(absent, Absent::Library { .. }), "{absent}");
    }

    /// Libraries that a C compiler made, each with all functions but one.
    #[cfg(unix)]
    #[test]
    fn libraries_that_lack_a_function_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let build = |symbols: &[&str], name: &str| {
            let source: String =
                symbols.iter().map(|symbol| format!("int {symbol}(void) {{ return -1; }}\n")).collect();
            let (code, library) = (folder.path().join("stub.c"), folder.path().join(name));
            std::fs::write(&code, source).unwrap();
            let compiler = Command::new("cc").args(["-shared", "-fPIC", "-w", "-o"]).arg(&library).arg(&code).status();
            compiler.is_ok_and(|status| status.success()).then(|| library.to_str().unwrap().to_owned())
        };
        let Some(whole) = build(SYMBOLS, "whole.so") else {
            crate::complain("skipped: a C compiler absent");
            return;
        };
        assert!(Gphoto::load(&[&whole]).is_ok());
        // The first, the last, and some between: each takes a compiler.
        for missing in SYMBOLS.iter().step_by(14).chain(SYMBOLS.last()) {
            let others: Vec<&str> = SYMBOLS.iter().filter(|symbol| *symbol != missing).copied().collect();
            let library = build(&others, &format!("without-{missing}.so")).unwrap();
            let absent = Gphoto::load(&[&library]).err().unwrap();
            assert_eq!(absent, Absent::Symbol { name: library, symbol: missing });
            let said = absent.to_string();
            assert!(said.contains(missing) && said.contains("without-"), "{said}");
            assert!(absent.advice().contains("2.5.10"));
        }
    }

    #[test]
    fn the_library_of_this_machine_has_every_function() {
        match Gphoto::open() {
            Ok(gphoto) => {
                assert!(gphoto.version().starts_with("2."), "{}", gphoto.version());
                let refusal = gphoto.connect("usb:nowhere").err().unwrap();
                assert!(refusal.code < 0 && !refusal.said.is_empty(), "{refusal:?}");
            }
            Err(absent) => {
                assert!(!matches!(absent, Absent::Symbol { .. }), "{absent}");
                crate::complain(&format!("skipped: {absent}"));
            }
        }
    }

    #[test]
    fn texts_end_at_their_zero() {
        assert_eq!(letters(&[b'a'.cast_signed(), b'b'.cast_signed(), 0, b'c'.cast_signed()]), "ab");
        assert_eq!(c_text("ab\0c").as_bytes(), b"ab");
        // The layouts of the library's headers, on 64 bits.
        #[cfg(target_pointer_width = "64")]
        assert_eq!((size_of::<FilePath>(), size_of::<FileInfo>(), size_of::<StorageInfo>()), (1152, 272, 808));
    }
}
