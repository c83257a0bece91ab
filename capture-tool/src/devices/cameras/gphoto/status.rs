//! What is looked at before a capture, and what `relume devices` says of each camera.

use super::Options;
use super::body::{Body, Storage, Widget};
use super::library::Gphoto;
use super::settings::{self, Dials, Quantity};
use crate::capture::seconds;
use crate::devices::Finding;
use crate::rigs::Counts;

/// Percent. A capture takes hours, a battery's last tenth minutes: below, it does not begin; below the second, it is said.
const BATTERY_LEAST: f64 = 10.0;
const BATTERY_LOW: f64 = 20.0;
/// Bytes: fewer are less than one raw file of the largest sensors.
const ROOM_LEAST: u64 = 200 << 20;

/// What to know before the start.
pub fn findings(
    name: &str,
    options: &Options,
    dials: &Dials,
    widgets: &[Widget],
    storages: &[Storage],
) -> Vec<Finding> {
    let mut found = vec![Finding::fine(format!("camera: {name}"))];
    if dials.time.is_none() {
        found.push(Finding::missing(format!(
            "camera: {name} has no shutter speed that can be set over USB; put its mode dial on M, or use driver = \"folder\""
        )));
    }
    match settings::is_manual(widgets) {
        Some((false, mode)) => {
            found.push(Finding::missing(format!("camera: its mode dial stands on {mode}; turn it to M")));
        }
        Some((true, mode)) => found.push(Finding::fine(format!("camera: mode {mode}"))),
        None => {}
    }
    if settings::chooses_iso(widgets) {
        let text = "camera: it chooses the ISO speed by itself; switch automatic ISO off";
        found.push(Finding::missing(text));
    }
    found.extend(battery(widgets));
    found.extend(format(options, dials, widgets));
    found.extend(room(dials, widgets, storages));
    found
}

fn battery(widgets: &[Widget]) -> Option<Finding> {
    let percent = settings::battery(widgets)?;
    Some(match percent {
        p if p < BATTERY_LEAST => {
            Finding::missing(format!("camera: battery {p:.0} %; charge it, or feed the camera from the mains"))
        }
        p if p < BATTERY_LOW => Finding::fine(format!("camera: battery {p:.0} %: charge it soon")),
        p => Finding::fine(format!("camera: battery {p:.0} %")),
    })
}

fn format(options: &Options, dials: &Dials, widgets: &[Widget]) -> Option<Finding> {
    let name = dials.format.as_ref()?;
    let format = widgets.iter().find(|widget| widget.name == *name)?.value.words();
    Some(about_format(&format, options.counts))
}

/// Can a photograph in this format be read?
fn about_format(format: &str, counts: Counts) -> Finding {
    let lower = format.to_lowercase();
    let has_raw = ["raw", "nef", "arw", "cr2", "cr3", "raf"].iter().any(|kind| lower.contains(kind));
    let has_picture = !has_raw || lower.contains('+');
    match counts {
        Counts::Raw if !has_raw => Finding::missing(format!(
            "camera: it makes {format} files, and counts = \"raw\"; set format to a raw one in the rig file"
        )),
        Counts::Raw if !cfg!(feature = "raw") => Finding::missing(
            "camera: counts = \"raw\", which this relume was built without (cargo build --features raw); capture RAW + JPEG with \
             counts = \"picture\": the raw files are kept beside",
        ),
        Counts::Picture if !has_picture => Finding::missing(format!(
            "camera: it makes {format} files alone; set format to RAW + JPEG or JPEG in the rig file, or counts = \"raw\""
        )),
        _ => Finding::fine(format!("camera: image format {format}")),
    }
}

/// Room on the card; none where the camera says nothing, or stores nothing on one.
fn room(dials: &Dials, widgets: &[Widget], storages: &[Storage]) -> Option<Finding> {
    let target = dials.target.as_ref().and_then(|name| widgets.iter().find(|widget| widget.name == *name));
    if target.is_some_and(|target| target.value.words().to_lowercase().contains("ram")) {
        return None;
    }
    let free = storages.iter().filter_map(|storage| storage.free_bytes).max()?;
    let megabytes = free >> 20;
    if free >= ROOM_LEAST {
        return Some(Finding::fine(format!("camera: {megabytes} MB free on its card")));
    }
    Some(Finding::missing(format!("camera: {megabytes} MB free on its card; empty it, or put in another one")))
}

/// What `relume devices` says of cameras over USB, a line each.
pub fn list() -> Vec<String> {
    let gphoto = match Gphoto::open() {
        Ok(gphoto) => gphoto,
        Err(absent) => return vec![format!("camera over USB: {absent}; {}", absent.advice())],
    };
    let version = gphoto.version();
    match gphoto.cameras() {
        Err(refusal) => vec![format!("camera over USB: {}", refusal.trouble("a camera"))],
        Ok(none) if none.is_empty() => {
            vec![format!("camera over USB: none is connected and switched on (libgphoto2 {version})")]
        }
        Ok(cameras) => cameras
            .into_iter()
            .map(|(model, port)| {
                let told = gphoto.connect(&port).and_then(|mut device| {
                    let (widgets, storages) = (device.widgets()?, device.storages().unwrap_or_default());
                    Ok(describe(&widgets, &storages))
                });
                match told {
                    Ok(told) => format!("camera {model}, port {port}: {told}"),
                    Err(refusal) => format!("camera {model}, port {port}: {}", refusal.trouble("it")),
                }
            })
            .collect(),
    }
}

/// What a camera can do, in a line.
fn describe(widgets: &[Widget], storages: &[Storage]) -> String {
    let dials = Dials::of(widgets);
    let widget = |name: &Option<String>| name.as_ref().and_then(|name| widgets.iter().find(|w| w.name == *name));
    let span = |name: &Option<String>, quantity, say: &dyn Fn(f64) -> String| {
        let numbers = settings::numbers(widget(name)?, quantity);
        Some((say(*numbers.first()?), say(*numbers.last()?)))
    };
    let mut said = Vec::new();
    said.push(match span(&dials.time, Quantity::Time, &seconds) {
        Some((fastest, slowest)) => format!("{fastest} to {slowest}"),
        None => "no shutter speed to set".to_owned(),
    });
    said.push(match span(&dials.iso, Quantity::Iso, &|iso| format!("{iso:.0}")) {
        Some((least, most)) => format!("ISO {least} to {most}"),
        None => "no ISO to set".to_owned(),
    });
    said.push(match span(&dials.f_number, Quantity::FNumber, &|n| format!("f/{n}")) {
        Some((widest, narrowest)) => format!("{widest} to {narrowest}"),
        None => "no aperture to set".to_owned(),
    });
    if let Some(format) = widget(&dials.format) {
        let Widget { value, choices, .. } = format;
        said.push(format!("format \"{}\" of \"{}\"", value.words(), choices.join("\", \"")));
    }
    said.extend(settings::is_manual(widgets).map(|(_, mode)| format!("mode {mode}")));
    said.extend(settings::battery(widgets).map(|percent| format!("battery {percent:.0} %")));
    let free = storages.iter().filter_map(|storage| storage.free_bytes).max();
    said.extend(free.map(|free| format!("{} MB free", free >> 20)));
    said.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::devices::cameras::gphoto::Value;

    fn widget(name: &str, value: &str, choices: &[&str]) -> Widget {
        Widget {
            name: name.to_owned(),
            label: name.to_owned(),
            readonly: false,
            value: Value::Text(value.to_owned()),
            choices: choices.iter().map(|choice| (*choice).to_owned()).collect(),
        }
    }

    fn missing(widgets: &[Widget], options: &Options, free_bytes: u64) -> Vec<String> {
        let storages = [Storage { free_bytes: Some(free_bytes), ..Storage::default() }];
        let found = findings("the X", options, &Dials::of(widgets), widgets, &storages);
        found.into_iter().filter(|finding| !finding.fine).map(|finding| finding.text).collect()
    }

    #[test]
    fn what_stands_in_the_way_is_said() {
        let good = vec![
            widget("shutterspeed", "1/60", &["1/60", "1/30"]),
            widget("expprogram", "M", &["M", "A"]),
            widget("batterylevel", "80%", &[]),
            widget("imageformat", "Large Fine JPEG", &["Large Fine JPEG", "RAW"]),
        ];
        let options = Options::default();
        assert_eq!(missing(&good, &options, 1 << 33), Vec::<String>::new());
        let with = |n: usize, bad: Widget| {
            let mut widgets = good.clone();
            widgets[n] = bad;
            missing(&widgets, &options, 1 << 33)
        };
        let one = |found: Vec<String>, words: &str| {
            assert!(found.len() == 1 && found[0].contains(words), "{words}: {found:?}");
        };
        one(with(0, widget("other", "1", &[])), "no shutter speed");
        one(with(1, widget("expprogram", "A", &[])), "stands on A; turn it to M");
        one(with(1, widget("isoauto", "On", &[])), "automatic ISO");
        one(with(2, widget("batterylevel", "5%", &[])), "battery 5 %; charge it");
        assert!(with(2, widget("batterylevel", "15%", &[])).is_empty());
        one(with(3, widget("imageformat", "RAW", &[])), "RAW + JPEG");
        assert!(with(3, widget("imageformat", "RAW + Large Fine JPEG", &[])).is_empty());
        one(missing(&good, &options, 1000), "0 MB free on its card; empty it");
        let raw = Options { counts: Counts::Raw, ..Options::default() };
        one(missing(&good, &raw, 1 << 33), "counts = \"raw\"; set format");
    }

    #[test]
    fn cameras_are_described() {
        let widgets = [
            widget("shutterspeed", "1/60", &["30", "1/8000", "1/60", "Bulb"]),
            widget("f-number", "f/8", &["f/2.8", "f/22"]),
            widget("batterylevel", "50%", &[]),
        ];
        let said = describe(&widgets, &[]);
        assert_eq!(said, "1/8000 s to 30 s, no ISO to set, f/2.8 to f/22, battery 50 %");
    }
}
