//! Cameras over USB, through libgphoto2.
//!
//! An exposure: settings to the nearest choice the camera has, each read back (one out of range returns success and becomes
//! something else); what the camera still has to say is heard out, so that files of exposures before are never taken for this
//! one; the shutter; the first file's name comes with its closing, a raw file's beside a JPEG as an event; each is
//! downloaded whole, and deleted from the camera.
//!
//! Where photographs go (`capturetarget`: the camera's own memory or its card) stays as the camera has it, for both are downloaded and
//! deleted alike; `keep_on_card` sets it to the card.
//!
//! | part | what it holds |
//! |---|---|
//! | [`body`] | what a camera can be asked |
//! | [`library`] | libgphoto2 behind it: the one file of unsafe code |
//! | [`words`] | what its errors mean |
//! | [`settings`] | texts like "1/60" and "f/8", and the nearest choice |
//! | [`files`] | the files of an exposure |
//! | [`status`] | what is looked at before the start, and what `relume devices` says |

mod body;
mod files;
mod library;
mod settings;
mod status;
#[cfg(test)]
mod tests;
mod words;

use std::collections::HashSet;
use std::path::Path;
use std::time::{Duration, Instant};

use body::{Body, Event, Place, Refusal, Value, Widget};
use library::Gphoto;
use settings::{Dials, Quantity};
pub use status::list;
use words::Kind;

use crate::devices::{Camera, Delivered, Finding, Trouble};
use crate::progress;
use crate::rigs::Counts;
use crate::session::Exposure;

/// Cameras need so many looks, this far apart, until a setting that they were given reads back.
const LOOKS: usize = 5;
const LOOK_PAUSE: Duration = Duration::from_millis(40);
/// What a camera still has to say is heard out for this long at most.
const HEAR_OUT: Duration = Duration::from_secs(2);
/// A camera that says nothing for so long has said all.
const QUIET: Duration = Duration::from_millis(1);

/// How a rig file wants a camera driven.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Options {
    /// A part of the model's name.
    pub model: Option<String>,
    /// As `relume devices` lists it.
    pub port: Option<String>,
    /// The camera's image format.
    pub format: Option<String>,
    /// Which of two files counts.
    pub counts: Counts,
    /// Delete nothing.
    pub keep_on_card: bool,
}

/// Makes the connection, at first and again.
type Connect = Box<dyn Fn() -> Result<Box<dyn Body>, Refusal>>;

/// A camera.
pub struct GphotoCamera {
    connect: Connect,
    /// None while the connection is lost.
    body: Option<Box<dyn Body>>,
    /// As in "the Nikon DSC D750 (usb:001,004)".
    name: String,
    options: Options,
    dials: Dials,
    wanted: Option<Exposure>,
    /// Files of the exposure that was made and is not downloaded.
    exposed: Vec<Exposed>,
    /// Files on the camera that are of no exposure in flight: they never count.
    others: HashSet<Place>,
    /// How many files an exposure makes, where that is known.
    files_each: Option<usize>,
    /// The connection was made anew since the last photograph.
    made_anew: bool,
    /// So long the second of two files is waited for.
    second_file: Duration,
    /// So long a camera that does not tell its format is watched for a second file, once.
    learn: Duration,
}

/// A file of an exposure.
#[derive(Debug, Clone)]
struct Exposed {
    place: Place,
    stored: Option<std::path::PathBuf>,
}

/// Opens the camera that a rig file means.
///
/// # Errors
/// No library, no such camera or several, one that another program holds.
pub fn open(options: &Options) -> Result<GphotoCamera, Trouble> {
    let gphoto = Gphoto::open().map_err(|absent| Trouble::stop(absent.to_string(), absent.advice()))?;
    let there = gphoto.cameras().map_err(|refusal| refusal.trouble("a camera"))?;
    let (model, port) = choose(&there, options)?;
    let name = format!("the {model} ({port})");
    let connect = move || {
        // A camera that was switched off and on has another port: its only namesake is it.
        let there = gphoto.cameras()?;
        let namesakes: Vec<&String> = there.iter().filter(|(name, _)| *name == model).map(|(_, port)| port).collect();
        let at = if let [only] = namesakes[..] { only } else { &port };
        gphoto.connect(at).map(|device| Box::new(device) as Box<dyn Body>)
    };
    GphotoCamera::new(name, options.clone(), Box::new(connect))
}

/// The one camera that is meant.
fn choose(there: &[(String, String)], options: &Options) -> Result<(String, String), Trouble> {
    let names = |model: &str| {
        let part = options.model.as_deref().unwrap_or_default().to_lowercase();
        model.to_lowercase().contains(&part)
    };
    let meant =
        |(model, port): &&(String, String)| names(model) && options.port.as_ref().is_none_or(|wanted| wanted == port);
    let found: Vec<&(String, String)> = there.iter().filter(meant).collect();
    let listed = || {
        let cameras: Vec<String> = there.iter().map(|(model, port)| format!("{model} ({port})")).collect();
        cameras.join(", ")
    };
    match found[..] {
        [one] => Ok(one.clone()),
        [] if there.is_empty() => Err(Trouble::stop(
            "no camera is connected over USB",
            "check its cable and that it is switched on, and set it to PTP or PC remote where its menu has a choice; \
             `relume devices` lists cameras",
        )),
        [] => {
            let wanted: Vec<&str> = options.model.iter().chain(&options.port).map(String::as_str).collect();
            let what = format!("no camera \"{}\" is connected, but {}", wanted.join("\" at \""), listed());
            Err(Trouble::stop(what, "correct model or port of the camera in the rig file"))
        }
        _ => Err(Trouble::stop(
            format!("several cameras are connected: {}", listed()),
            "say which by model or port of the camera in the rig file",
        )),
    }
}

impl GphotoCamera {
    /// Of a camera that can be connected to.
    fn new(name: String, options: Options, connect: Connect) -> Result<Self, Trouble> {
        let mut camera = Self {
            connect,
            body: None,
            name,
            options,
            dials: Dials::default(),
            wanted: None,
            exposed: Vec::new(),
            others: HashSet::new(),
            files_each: None,
            made_anew: false,
            second_file: files::SECOND_FILE,
            learn: files::LEARN,
        };
        camera.begin().map_err(|refusal| refusal.trouble(&camera.name))??;
        Ok(camera)
    }

    /// Connects, and sets what stays the same for all photographs.
    fn begin(&mut self) -> Result<Result<(), Trouble>, Refusal> {
        // Two connections at a time are refused.
        self.body = None;
        let mut body = (self.connect)()?;
        self.dials = Dials::of(&body.widgets()?);
        let fixed = self.set_format(&mut *body)?.and(self.set_target(&mut *body)?);
        self.files_each = match &self.dials.format {
            Some(format) => Some(if body.widget(format)?.value.words().contains('+') { 2 } else { 1 }),
            // Learnt from the first photograph.
            None => self.files_each,
        };
        self.body = Some(body);
        Ok(fixed)
    }

    fn set_format(&self, body: &mut dyn Body) -> Result<Result<(), Trouble>, Refusal> {
        let Some(wanted) = &self.options.format else { return Ok(Ok(())) };
        let Some(format) = &self.dials.format else {
            let what = format!("{} has no image format to set", self.name);
            return Ok(Err(Trouble::stop(what, "set it at the camera, and leave format out of the rig file")));
        };
        let choices = body.widget(format)?.choices;
        let same = |choice: &&String| choice.to_lowercase() == wanted.to_lowercase();
        let refuse = |what: String| {
            let advice = format!("of its formats, {}, write one into the rig file", choices.join(", "));
            Ok(Err(Trouble::stop(what, advice)))
        };
        let Some(choice) = choices.iter().find(same) else {
            return refuse(format!("{} has no image format \"{wanted}\"", self.name));
        };
        let took = settle(body, format, &Value::Text(choice.clone()))?.value.words();
        if took == *choice {
            return Ok(Ok(()));
        }
        refuse(format!("{} was set to image format \"{choice}\" and reads back \"{took}\"", self.name))
    }

    fn set_target(&self, body: &mut dyn Body) -> Result<Result<(), Trouble>, Refusal> {
        let Some(target) = self.dials.target.as_ref().filter(|_| self.options.keep_on_card) else { return Ok(Ok(())) };
        let widget = body.widget(target)?;
        let Some(card) = widget.choices.iter().find(|choice| choice.to_lowercase().contains("card")) else {
            return Ok(Ok(()));
        };
        let took = settle(body, target, &Value::Text(card.clone()))?.value.words();
        if took == *card {
            return Ok(Ok(()));
        }
        let what = format!("{} was told to store photographs on its card and reads back \"{took}\"", self.name);
        Ok(Err(Trouble::stop(what, "put a card in, or leave keep_on_card out of the rig file")))
    }

    /// Asks; makes a lost connection again once, and asks again.
    fn ask<T>(&mut self, ask: impl Fn(&mut dyn Body) -> Result<T, Refusal>) -> Result<T, Trouble> {
        match self.ask_once(&ask)? {
            Ok(answer) => Ok(answer),
            Err(refusal) if refusal.kind() == Kind::Lost => {
                self.connect_again(&refusal)?;
                self.ask_once(&ask)?.map_err(|refusal| refusal.trouble(&self.name))
            }
            Err(refusal) => Err(refusal.trouble(&self.name)),
        }
    }

    fn ask_once<T>(
        &mut self,
        ask: impl Fn(&mut dyn Body) -> Result<T, Refusal>,
    ) -> Result<Result<T, Refusal>, Trouble> {
        if self.body.is_none() {
            let lost = Refusal { code: -7, doing: "connecting".to_owned(), said: "the connection was lost".to_owned() };
            self.connect_again(&lost)?;
        }
        Ok(match &mut self.body {
            Some(body) => ask(&mut **body),
            None => Err(Refusal { code: -105, doing: "connecting".to_owned(), said: "no camera".to_owned() }),
        })
    }

    /// Makes a lost connection again, with the settings it had; not twice for one photograph.
    fn connect_again(&mut self, lost: &Refusal) -> Result<(), Trouble> {
        self.body = None;
        if std::mem::replace(&mut self.made_anew, true) {
            return Err(lost.trouble(&self.name));
        }
        self.begin().map_err(|_| lost.trouble(&self.name))??;
        if let Some(wanted) = self.wanted {
            self.dial(&wanted)?;
        }
        Ok(())
    }

    /// Sets each number that the camera has a setting for, and says what it is then.
    fn dial(&mut self, wanted: &Exposure) -> Result<Exposure, Trouble> {
        let dials = self.dials.clone();
        let Some(time) = &dials.time else { return Err(self.no_time()) };
        let numbers = [
            (dials.f_number.as_ref(), wanted.f_number, Quantity::FNumber),
            (dials.iso.as_ref(), wanted.iso, Quantity::Iso),
            (Some(time), Some(wanted.time_s), Quantity::Time),
        ];
        for (name, number, quantity) in numbers {
            let Some((name, number)) = name.zip(number) else { continue };
            self.ask(|body| {
                let widget = body.widget(name)?;
                match settings::nearest(&widget, number, quantity) {
                    Some(value) if value != widget.value && !widget.readonly => settle(body, name, &value).map(|_| ()),
                    _ => Ok(()),
                }
            })?;
        }
        self.read_dials()
    }

    fn no_time(&self) -> Trouble {
        Trouble::stop(
            format!("{} has no shutter speed that can be set over USB", self.name),
            "put its mode dial on M; where its maker does not allow it, use driver = \"folder\" with the maker's software",
        )
    }

    fn read_dials(&mut self) -> Result<Exposure, Trouble> {
        let dials = self.dials.clone();
        let Some(time) = &dials.time else { return Err(self.no_time()) };
        let read = |camera: &mut Self, name: &Option<String>, quantity| {
            let Some(name) = name else { return Ok(None) };
            let value = camera.ask(|body| body.widget(name))?.value;
            Ok::<_, Trouble>(settings::number(&value, quantity))
        };
        let now = self.ask(|body| body.widget(time))?.value;
        let Some(time_s) = settings::number(&now, Quantity::Time) else {
            let what = format!("the shutter speed of {} reads \"{}\"", self.name, now.words());
            return Err(Trouble::stop(what, "put its mode dial on M and choose a time"));
        };
        let iso = read(self, &dials.iso, Quantity::Iso)?;
        let f_number = read(self, &dials.f_number, Quantity::FNumber)?;
        Ok(Exposure { time_s, iso, f_number })
    }

    /// Hears the camera out: files it still announces are of exposures before.
    fn hear_out(&mut self) -> Result<(), Trouble> {
        let begun = Instant::now();
        while begun.elapsed() < HEAR_OUT {
            progress::check_urgent()?;
            match self.ask(|body| body.event(QUIET))? {
                Event::Quiet => break,
                Event::Stored(place) => drop(self.others.insert(place)),
                Event::Complete | Event::Other => {}
            }
        }
        Ok(())
    }
}

/// Sets a widget and looks until it reads back so, for a moment: some cameras answer before they have done it.
fn settle(body: &mut dyn Body, name: &str, value: &Value) -> Result<Widget, Refusal> {
    body.set(name, value)?;
    let mut widget = body.widget(name)?;
    for _ in 1..LOOKS {
        if widget.value == *value {
            break;
        }
        std::thread::sleep(LOOK_PAUSE);
        widget = body.widget(name)?;
    }
    Ok(widget)
}

impl Camera for GphotoCamera {
    fn preflight(&mut self) -> Vec<Finding> {
        let looked = self.ask(|body| Ok((body.widgets()?, body.storages().unwrap_or_default())));
        match looked {
            Ok((widgets, storages)) => status::findings(&self.name, &self.options, &self.dials, &widgets, &storages),
            Err(trouble) => vec![Finding::missing(format!("camera: {trouble}"))],
        }
    }

    fn set(&mut self, wanted: &Exposure) -> Result<Exposure, Trouble> {
        self.wanted = Some(*wanted);
        self.dial(wanted)
    }

    fn setting(&mut self) -> Result<Option<Exposure>, Trouble> {
        self.read_dials().map(Some)
    }

    /// Blocks while the shutter is open: libgphoto2 cannot be interrupted in it.
    fn expose(&mut self) -> Result<(), Trouble> {
        self.hear_out()?;
        // What an exposure before left, which was given up.
        self.others.extend(self.exposed.drain(..).map(|file| file.place));
        match self.ask_once(|body| body.capture())? {
            Ok(place) if self.others.contains(&place) => {
                Err(Trouble::Busy(format!("{} answers with {}, a photograph from before", self.name, place.name)))
            }
            Ok(place) => {
                self.exposed = vec![Exposed { place, stored: None }];
                Ok(())
            }
            // Nobody knows whether the shutter opened: the photograph is taken again, and a file that comes late is not it.
            Err(refusal) if refusal.kind() == Kind::Lost => {
                self.connect_again(&refusal)?;
                Err(Trouble::Busy(format!("the connection to {} was lost and made again", self.name)))
            }
            Err(refusal) => Err(refusal.trouble(&self.name)),
        }
    }

    fn download(&mut self, folder: &Path, stem: &str) -> Result<Delivered, Trouble> {
        self.gather()?;
        let delivered = self.store(folder, stem)?;
        self.made_anew = false;
        Ok(delivered)
    }
}
