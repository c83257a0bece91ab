//! The camera's logic against a scripted body.

use std::cell::RefCell;
use std::collections::{HashMap, VecDeque};
use std::rc::Rc;

use super::body::Storage;
use super::*;

/// What a scripted camera has and does.
#[derive(Default)]
struct Script {
    widgets: Vec<Widget>,
    files: HashMap<Place, Vec<u8>>,
    events: VecDeque<Event>,
    /// Names of what each next exposure makes: the first is its answer, the others are events.
    makes: VecDeque<Vec<&'static str>>,
    /// Refusals that come first, by call.
    refuses: VecDeque<(&'static str, i32)>,
    /// Downloads that come short.
    short: u32,
    deleted: Vec<String>,
    connections: u32,
}

type Shared = Rc<RefCell<Script>>;

struct Scripted(Shared);

const PICTURE: &[u8] = &[0xff, 0xd8, 0xff, 0xda, 0, 2, 1, 2, 3, 0xff, 0xd9];

fn place(name: &str) -> Place {
    Place { folder: "/card".to_owned(), name: name.to_owned() }
}

impl Scripted {
    fn call(&self, call: &str) -> Result<(), Refusal> {
        let mut script = self.0.borrow_mut();
        if script.refuses.front().is_some_and(|(refused, _)| *refused == call) {
            let (_, code) = script.refuses.pop_front().unwrap();
            return Err(Refusal { code, doing: call.to_owned(), said: "as scripted".to_owned() });
        }
        Ok(())
    }
}

impl Body for Scripted {
    fn widgets(&mut self) -> Result<Vec<Widget>, Refusal> {
        self.call("widgets")?;
        Ok(self.0.borrow().widgets.clone())
    }

    fn widget(&mut self, name: &str) -> Result<Widget, Refusal> {
        self.call("widget")?;
        let script = self.0.borrow();
        let found = script.widgets.iter().find(|widget| widget.name == name).cloned();
        found.ok_or(Refusal { code: -2, doing: name.to_owned(), said: "no such widget".to_owned() })
    }

    /// Takes any text; what is not among the choices becomes the first one, and nothing is said.
    fn set(&mut self, name: &str, value: &Value) -> Result<(), Refusal> {
        self.call("set")?;
        let mut script = self.0.borrow_mut();
        let widget = script.widgets.iter_mut().find(|widget| widget.name == name).unwrap();
        assert!(!widget.readonly, "{name} is set though it cannot be");
        let known = widget.choices.contains(&value.words());
        widget.value = if known { value.clone() } else { Value::Text(widget.choices[0].clone()) };
        Ok(())
    }

    fn capture(&mut self) -> Result<Place, Refusal> {
        self.call("capture")?;
        let mut script = self.0.borrow_mut();
        let names = script.makes.pop_front().unwrap_or_else(|| vec!["a.JPG"]);
        for name in &names {
            let bytes = if name.ends_with("JPG") { PICTURE.to_vec() } else { name.as_bytes().to_vec() };
            script.files.insert(place(name), bytes);
        }
        let others: Vec<Event> = names[1..].iter().map(|name| Event::Stored(place(name))).collect();
        script.events.extend([Event::Other]);
        script.events.extend(others);
        script.events.extend([Event::Complete]);
        Ok(place(names[0]))
    }

    fn event(&mut self, wait: Duration) -> Result<Event, Refusal> {
        self.call("event")?;
        let event = self.0.borrow_mut().events.pop_front();
        if event.is_none() {
            std::thread::sleep(wait.min(Duration::from_millis(2)));
        }
        Ok(event.unwrap_or(Event::Quiet))
    }

    fn size(&mut self, place: &Place) -> Result<Option<u64>, Refusal> {
        Ok(self.0.borrow().files.get(place).map(|bytes| bytes.len() as u64))
    }

    fn fetch(&mut self, place: &Place) -> Result<Vec<u8>, Refusal> {
        self.call("fetch")?;
        let mut script = self.0.borrow_mut();
        let bytes = script.files.get(place).cloned();
        let bytes = bytes.ok_or(Refusal { code: -108, doing: "fetch".to_owned(), said: "no such file".to_owned() })?;
        let short = script.short > 0;
        script.short = script.short.saturating_sub(1);
        Ok(if short { bytes[..bytes.len() / 2].to_vec() } else { bytes })
    }

    fn delete(&mut self, place: &Place) -> Result<(), Refusal> {
        self.call("delete")?;
        let mut script = self.0.borrow_mut();
        script.files.remove(place);
        script.deleted.push(place.name.clone());
        Ok(())
    }

    fn storages(&mut self) -> Result<Vec<Storage>, Refusal> {
        Ok(Vec::new())
    }
}

fn widget(name: &str, value: &str, choices: &[&str]) -> Widget {
    Widget {
        name: name.to_owned(),
        label: name.to_owned(),
        readonly: false,
        value: Value::Text(value.to_owned()),
        choices: choices.iter().map(|choice| (*choice).to_owned()).collect(),
    }
}

/// A camera that can do 1/8000 to 30 s, ISO and apertures, RAW and JPEG.
fn script() -> Shared {
    let widgets = vec![
        widget("shutterspeed", "1/60", &["1/8000", "1/60", "1/30", "0.5", "30", "Bulb"]),
        widget("iso", "100", &["100", "200", "400"]),
        widget("aperture", "8", &["5.6", "8", "11"]),
        widget("imageformat", "Fine", &["Fine", "RAW", "RAW + Fine"]),
        widget("capturetarget", "Internal RAM", &["Internal RAM", "Memory card"]),
    ];
    Rc::new(RefCell::new(Script { widgets, ..Script::default() }))
}

fn open_with(script: &Shared, options: Options) -> Result<GphotoCamera, Trouble> {
    let shared = script.clone();
    let connect = move || {
        Scripted(shared.clone()).call("connect")?;
        shared.borrow_mut().connections += 1;
        Ok(Box::new(Scripted(shared.clone())) as Box<dyn Body>)
    };
    let mut camera = GphotoCamera::new("the Test (usb:1)".to_owned(), options, Box::new(connect))?;
    camera.second_file = Duration::from_millis(60);
    camera.learn = Duration::from_millis(30);
    Ok(camera)
}

fn open(script: &Shared) -> GphotoCamera {
    open_with(script, Options::default()).unwrap()
}

fn exposure(time_s: f64) -> Exposure {
    Exposure { time_s, iso: Some(200.0), f_number: Some(11.0) }
}

/// Exposes and downloads; asks again when busy.
fn photograph(camera: &mut GphotoCamera, folder: &Path) -> Result<Vec<String>, Trouble> {
    let mut patience = 5;
    let mut again = |trouble: Trouble| {
        patience -= 1;
        if patience > 0 && matches!(trouble, Trouble::Busy(_)) { Ok(()) } else { Err(trouble) }
    };
    while let Err(trouble) = camera.expose() {
        again(trouble)?;
    }
    loop {
        match camera.download(folder, "000001-1") {
            Ok(delivered) => {
                let name = |path: &std::path::PathBuf| path.file_name().unwrap().to_str().unwrap().to_owned();
                return Ok(delivered.files.iter().map(name).collect());
            }
            Err(trouble) => again(trouble)?,
        }
    }
}

#[test]
fn settings_go_to_the_nearest_choice_and_are_read_back() {
    let script = script();
    let mut camera = open(&script);
    let took = camera.set(&exposure(0.034)).unwrap();
    assert_eq!(took, Exposure { time_s: 1.0 / 30.0, iso: Some(200.0), f_number: Some(11.0) });
    assert_eq!(camera.setting().unwrap(), Some(took));
    // Beyond what it can: the caller sees that it is something else.
    assert_eq!(camera.set(&exposure(120.0)).unwrap().time_s, 30.0);
    // A dial that rules: not set, and told as it is.
    script.borrow_mut().widgets[0].readonly = true;
    assert_eq!(camera.set(&exposure(0.5)).unwrap().time_s, 30.0);
    script.borrow_mut().widgets[0].value = Value::Text("Bulb".to_owned());
    let said = camera.setting().unwrap_err().to_string();
    assert!(said.contains("reads \"Bulb\"") && said.contains("mode dial on M"), "{said}");
    // Neither ISO nor aperture to set.
    script.borrow_mut().widgets.drain(1..3);
    script.borrow_mut().widgets[0] = widget("shutterspeed", "0.5", &["0.5"]);
    assert_eq!(open(&script).set(&exposure(0.5)).unwrap(), Exposure { time_s: 0.5, iso: None, f_number: None });
    script.borrow_mut().widgets.remove(0);
    let said = open(&script).set(&exposure(0.5)).unwrap_err().to_string();
    assert!(said.contains("no shutter speed"), "{said}");
}

#[test]
fn a_photograph_is_downloaded_and_deleted() {
    let (script, folder) = (script(), tempfile::tempdir().unwrap());
    let mut camera = open(&script);
    assert_eq!(photograph(&mut camera, folder.path()).unwrap(), ["000001-1.JPG"]);
    assert_eq!(std::fs::read(folder.path().join("000001-1.JPG")).unwrap(), PICTURE);
    assert_eq!(script.borrow().deleted, ["a.JPG"]);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "nothing else is left");
    // The camera gives the name again.
    assert_eq!(photograph(&mut camera, folder.path()).unwrap(), ["000001-1.JPG"]);
}

#[test]
fn raw_files_come_as_events() {
    for (counts, order) in
        [(Counts::Picture, ["000001-1.JPG", "000001-1.NEF"]), (Counts::Raw, ["000001-1.NEF", "000001-1.JPG"])]
    {
        let (script, folder) = (script(), tempfile::tempdir().unwrap());
        script.borrow_mut().makes = VecDeque::from([vec!["a.NEF", "a.JPG"], vec!["b.NEF", "b.JPG"], vec!["c.JPG"]]);
        let options = Options { format: Some("raw + fine".to_owned()), counts, ..Options::default() };
        let mut camera = open_with(&script, options).unwrap();
        assert_eq!(script.borrow().widgets[3].value.words(), "RAW + Fine");
        assert_eq!(photograph(&mut camera, folder.path()).unwrap(), order);
        assert_eq!(photograph(&mut camera, folder.path()).unwrap(), order);
        assert_eq!(script.borrow().deleted.len(), 4);
        let said = photograph(&mut camera, folder.path()).unwrap_err().to_string();
        assert!(said.contains("makes two files") && said.contains("only c.JPG came"), "{said}");
    }
    // A camera that does not tell its format.
    let (script, folder) = (script(), tempfile::tempdir().unwrap());
    script.borrow_mut().widgets.remove(3);
    script.borrow_mut().makes = VecDeque::from([vec!["a.JPG", "a.NEF", "a.WAV"], vec!["b.JPG", "b.NEF"]]);
    let mut camera = open(&script);
    for _ in 0..2 {
        assert_eq!(photograph(&mut camera, folder.path()).unwrap(), ["000001-1.JPG", "000001-1.NEF"]);
    }
    assert_eq!(camera.files_each, Some(2));
}

#[test]
fn files_of_other_exposures_never_count() {
    let (script, folder) = (script(), tempfile::tempdir().unwrap());
    let mut camera = open(&script);
    // Somebody pressed the shutter, and the camera tells now.
    script.borrow_mut().files.insert(place("old.JPG"), b"old".to_vec());
    script.borrow_mut().events.push_back(Event::Stored(place("old.JPG")));
    // Then it answers with that file, and again when asked the next time with the right one.
    script.borrow_mut().makes = VecDeque::from([vec!["old.JPG"], vec!["new.JPG"]]);
    assert_eq!(photograph(&mut camera, folder.path()).unwrap().len(), 1);
    assert_eq!(script.borrow().deleted, ["new.JPG"]);
    assert!(script.borrow().files.contains_key(&place("old.JPG")), "it is not ours");
    // Of two files the second must not be the old one either.
    let options = Options { format: Some("RAW + Fine".to_owned()), ..Options::default() };
    let mut camera = open_with(&script, options).unwrap();
    camera.others.insert(place("old.JPG"));
    script.borrow_mut().makes = VecDeque::from([vec!["c.NEF", "old.JPG", "c.JPG"]]);
    photograph(&mut camera, folder.path()).unwrap();
    assert_eq!(script.borrow().deleted, ["new.JPG", "c.NEF", "c.JPG"]);
}

#[test]
fn busy_cameras_are_asked_again_and_lost_ones_connected_again() {
    let (script, folder) = (script(), tempfile::tempdir().unwrap());
    let mut camera = open(&script);
    camera.set(&exposure(0.5)).unwrap();
    script.borrow_mut().refuses = VecDeque::from([("capture", -110), ("capture", -110), ("fetch", -110)]);
    photograph(&mut camera, folder.path()).unwrap();
    assert_eq!(script.borrow().connections, 1);
    // Lost while the shutter was open: connected again, set again, taken again. The late file is nobody's.
    script.borrow_mut().refuses = VecDeque::from([("capture", -7)]);
    script.borrow_mut().events.clear();
    script.borrow_mut().makes = VecDeque::from([vec!["b.JPG"]]);
    script.borrow_mut().widgets[0].value = Value::Text("1/60".to_owned());
    photograph(&mut camera, folder.path()).unwrap();
    assert_eq!(script.borrow().connections, 2);
    assert_eq!(script.borrow().widgets[0].value.words(), "0.5");
    // Twice for one photograph, or for good: the end.
    script.borrow_mut().refuses = VecDeque::from([("fetch", -7), ("fetch", -52)]);
    let said = photograph(&mut camera, folder.path()).unwrap_err().to_string();
    assert!(said.contains("does not answer") && said.contains("cable"), "{said}");
    camera.made_anew = false;
    script.borrow_mut().refuses = VecDeque::from([("event", -7), ("connect", -105)]);
    let said = photograph(&mut camera, folder.path()).unwrap_err().to_string();
    assert!(said.contains("does not answer"), "{said}");
}

#[test]
fn files_that_come_short_are_no_photographs() {
    let (script, folder) = (script(), tempfile::tempdir().unwrap());
    let mut camera = open(&script);
    script.borrow_mut().short = 2;
    photograph(&mut camera, folder.path()).unwrap();
    assert_eq!(std::fs::read(folder.path().join("000001-1.JPG")).unwrap(), PICTURE);
    script.borrow_mut().short = 100;
    camera.expose().unwrap();
    let Err(Trouble::Busy(said)) = camera.download(folder.path(), "000002-1") else { panic!() };
    assert!(said.contains("delivers 5 of 11 bytes of a.JPG"), "{said}");
    assert!(!folder.path().join("000002-1.JPG").exists());
}

#[test]
fn full_cards_and_other_ends_are_told() {
    let (script, folder) = (script(), tempfile::tempdir().unwrap());
    let mut camera = open(&script);
    for (code, words) in [(-115, "the card of the Test"), (-3, "empty it"), (-1, "libgphoto2's error -1")] {
        script.borrow_mut().refuses = VecDeque::from([("capture", code)]);
        let said = photograph(&mut camera, folder.path()).unwrap_err().to_string();
        assert!(said.contains(words), "{said}");
    }
    // It resumes.
    photograph(&mut camera, folder.path()).unwrap();
    script.borrow_mut().refuses = VecDeque::from([("connect", -53)]);
    let said = open_with(&script, Options::default()).err().unwrap().to_string();
    assert!(said.contains("another program holds the Test"), "{said}");
}

#[test]
fn what_stays_the_same_is_set_once() {
    let (script, folder) = (script(), tempfile::tempdir().unwrap());
    let options = Options { keep_on_card: true, ..Options::default() };
    let mut camera = open_with(&script, options).unwrap();
    assert_eq!(script.borrow().widgets[4].value.words(), "Memory card");
    photograph(&mut camera, folder.path()).unwrap();
    assert!(script.borrow().deleted.is_empty());
    let wrong = Options { format: Some("TIFF".to_owned()), ..Options::default() };
    let said = open_with(&script, wrong).err().unwrap().to_string();
    assert!(said.contains("no image format \"TIFF\"") && said.contains("Fine, RAW, RAW + Fine"), "{said}");
}

#[test]
fn the_camera_that_is_meant_is_chosen() {
    let there: Vec<(String, String)> = [("Nikon D750", "usb:1"), ("Canon R5", "usb:2"), ("Canon R5", "usb:3")]
        .map(|(m, p)| (m.into(), p.into()))
        .into();
    let options = |model: Option<&str>, port: Option<&str>| Options {
        model: model.map(str::to_owned),
        port: port.map(str::to_owned),
        ..Options::default()
    };
    assert_eq!(choose(&there, &options(Some("nikon"), None)).unwrap().1, "usb:1");
    assert_eq!(choose(&there, &options(Some("R5"), Some("usb:3"))).unwrap().1, "usb:3");
    assert_eq!(choose(&there[..1], &options(None, None)).unwrap().1, "usb:1");
    let said = |there: &[(String, String)], options: &Options| choose(there, options).unwrap_err().to_string();
    assert!(said(&there, &options(Some("canon"), None)).contains("several cameras"));
    assert!(said(&there, &options(Some("Sony"), None)).contains("no camera \"Sony\" is connected, but Nikon D750"));
    assert!(said(&[], &options(None, None)).contains("no camera is connected over USB"));
}
