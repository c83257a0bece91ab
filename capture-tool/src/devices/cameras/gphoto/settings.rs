//! The exposure's settings: which of a camera's many are meant, what their texts mean, and which choice is nearest to what is wanted.

use super::body::{Value, Widget};

/// Names of the shutter speed. Nikon's `shutterspeed` has four decimals, its `shutterspeed2` fractions: that one first.
const TIME: [&str; 3] = ["shutterspeed2", "shutterspeed", "exptime"];
const ISO: [&str; 2] = ["iso", "isospeed"];
const F_NUMBER: [&str; 2] = ["f-number", "aperture"];
const FORMAT: [&str; 2] = ["imageformat", "imagequality"];
const MODE: [&str; 3] = ["expprogram", "autoexposuremode", "exposuremode"];
const AUTO_ISO: [&str; 2] = ["isoauto", "autoiso"];

/// What a number of the exposure is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quantity {
    /// Seconds.
    Time,
    /// ISO speed.
    Iso,
    /// F-number.
    FNumber,
}

/// The names of a camera's settings that matter.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Dials {
    /// Shutter speed.
    pub time: Option<String>,
    /// ISO speed; many cameras have none to set.
    pub iso: Option<String>,
    /// F-number; lenses without contacts have none.
    pub f_number: Option<String>,
    /// Image format.
    pub format: Option<String>,
    /// Where photographs go: card or memory.
    pub target: Option<String>,
}

impl Dials {
    /// Found among all settings of a camera. Those without a number among their choices count as absent.
    pub fn of(widgets: &[Widget]) -> Self {
        let named = |names: &[&str]| {
            names.iter().find_map(|name| widgets.iter().find(|widget| widget.name == **name)).map(|w| w.name.clone())
        };
        let numbers = |names: &[&str], quantity: Quantity| {
            let has_numbers = |widget: &&Widget| {
                number(&widget.value, quantity).is_some()
                    || widget.choices.iter().any(|choice| parse(choice, quantity).is_some())
            };
            let found = names.iter().filter_map(|name| widgets.iter().find(|widget| widget.name == **name));
            // Of two that say the same, the one that can be set.
            let found: Vec<&Widget> = found.filter(has_numbers).collect();
            found.iter().find(|widget| !widget.readonly).or(found.first()).map(|widget| widget.name.clone())
        };
        Self {
            time: numbers(&TIME, Quantity::Time),
            iso: numbers(&ISO, Quantity::Iso),
            f_number: numbers(&F_NUMBER, Quantity::FNumber),
            format: named(&FORMAT),
            target: named(&["capturetarget"]),
        }
    }
}

/// Does the mode dial stand on manual? None where the camera does not tell.
pub fn is_manual(widgets: &[Widget]) -> Option<(bool, String)> {
    let mode = widgets.iter().find(|widget| MODE.contains(&widget.name.as_str()))?.value.words();
    let lower = mode.to_lowercase();
    Some((lower == "m" || lower.starts_with("manual"), mode))
}

/// Does the camera choose the ISO speed by itself?
pub fn chooses_iso(widgets: &[Widget]) -> bool {
    let on = |widget: &Widget| matches!(widget.value.words().to_lowercase().as_str(), "on" | "1" | "auto");
    let iso =
        |widget: &Widget| ISO.contains(&widget.name.as_str()) && widget.value.words().to_lowercase().contains("auto");
    widgets.iter().any(|widget| (AUTO_ISO.contains(&widget.name.as_str()) && on(widget)) || iso(widget))
}

/// How full the battery is, percent.
pub fn battery(widgets: &[Widget]) -> Option<f64> {
    let level = &widgets.iter().find(|widget| widget.name == "batterylevel")?.value;
    match level {
        Value::Number(number) => Some(f64::from(*number)),
        Value::Switch(_) => None,
        Value::Text(text) => match text.trim().to_lowercase().as_str() {
            // As some cameras say it in words.
            "low" => Some(10.0),
            "empty" => Some(0.0),
            "full" => Some(100.0),
            percent => percent.trim_end_matches('%').trim().parse().ok(),
        },
    }
}

/// The number of a value.
pub fn number(value: &Value, quantity: Quantity) -> Option<f64> {
    match value {
        Value::Text(text) => parse(text, quantity),
        Value::Number(number) => sane(f64::from(*number), quantity),
        Value::Switch(_) => None,
    }
}

/// The number that a camera's text stands for; none for "Bulb" and "Auto".
pub fn parse(text: &str, quantity: Quantity) -> Option<f64> {
    let text = text.trim().to_lowercase().replace(',', ".");
    let value = match quantity {
        Quantity::Time => seconds(&text)?,
        Quantity::Iso => text.trim_start_matches("iso").trim().parse().ok()?,
        Quantity::FNumber => text.trim_start_matches('f').trim_start_matches('/').trim().parse().ok()?,
    };
    sane(value, quantity)
}

/// Numbers outside are no settings: some cameras say "Bulb" as a huge one.
fn sane(value: f64, quantity: Quantity) -> Option<f64> {
    let range = match quantity {
        Quantity::Time => 1e-6..=1e4,
        Quantity::Iso => 1.0..=1e7,
        Quantity::FNumber => 0.5..=256.0,
    };
    range.contains(&value).then_some(value)
}

/// "1/60", "1/2.5", "0.0166s", "30", `30"`, `0"5`, "1/60 sec".
fn seconds(text: &str) -> Option<f64> {
    if let Some((whole, tenths)) = text.split_once('"')
        && !tenths.is_empty()
    {
        return format!("{whole}.{tenths}").parse().ok();
    }
    let bare = text.trim_end_matches("seconds").trim_end_matches("sec").trim_end_matches(['s', '"']).trim();
    match bare.split_once('/') {
        Some((above, below)) => Some(above.trim().parse::<f64>().ok()? / below.trim().parse::<f64>().ok()?),
        None => Some(unrounded(bare).unwrap_or(bare.parse().ok()?)),
    }
}

/// PTP says times in ten-thousandths of a second, cut off: 0.0012 is 1/800. The time of the series that cameras have,
/// thirds of stops, of which a text of four decimals is what is left.
fn unrounded(text: &str) -> Option<f64> {
    const SERIES: [u32; 34] = [
        8000, 6400, 5000, 4000, 3200, 2500, 2000, 1600, 1250, 1000, 800, 640, 500, 400, 320, 250, 200, 160, 125, 100,
        80, 60, 50, 40, 30, 25, 20, 15, 13, 10, 8, 6, 5, 4,
    ];
    let digits = text.strip_prefix("0.").filter(|digits| digits.len() == 4)?;
    let cut: u32 = digits.parse().ok()?;
    SERIES.iter().find(|n| 10_000 / **n == cut).map(|n| 1.0 / f64::from(*n))
}

/// What to set a widget to for a number: the nearest of its choices, by ratio.
pub fn nearest(widget: &Widget, wanted: f64, quantity: Quantity) -> Option<Value> {
    if let Value::Number(_) = widget.value {
        return Some(Value::Number(wanted as f32));
    }
    let away = |value: f64| (value / wanted).ln().abs();
    let known = widget.choices.iter().filter_map(|choice| Some((choice, away(parse(choice, quantity)?))));
    let best = known.min_by(|a, b| a.1.total_cmp(&b.1));
    best.map(|(choice, _)| Value::Text(choice.clone()))
}

/// The numbers of a setting's choices, in order.
pub fn numbers(widget: &Widget, quantity: Quantity) -> Vec<f64> {
    let mut numbers: Vec<f64> = widget.choices.iter().filter_map(|choice| parse(choice, quantity)).collect();
    numbers.sort_by(f64::total_cmp);
    numbers
}

#[cfg(test)]
mod tests {
    use super::*;

    fn widget(name: &str, value: &str, choices: &[&str]) -> Widget {
        Widget {
            name: name.to_owned(),
            label: name.to_owned(),
            readonly: false,
            value: Value::Text(value.to_owned()),
            choices: choices.iter().map(|choice| (*choice).to_owned()).collect(),
        }
    }

    #[test]
    fn texts_of_cameras_are_understood() {
        for (text, expected) in [
            ("1/60", 1.0 / 60.0),
            ("1/60s", 1.0 / 60.0),
            ("1/60 sec", 1.0 / 60.0),
            ("1/2.5", 0.4),
            ("0.5", 0.5),
            ("30", 30.0),
            ("30\"", 30.0),
            ("0\"5", 0.5),
            ("1\"3", 1.3),
            ("1.3s", 1.3),
            ("0,5", 0.5),
            ("0.0166s", 1.0 / 60.0),
            ("0.0012s", 1.0 / 800.0),
            ("0.0025", 1.0 / 400.0),
            ("0.1000s", 0.1),
            ("0.3333s", 0.3333),
            ("1.0000s", 1.0),
        ] {
            let found = parse(text, Quantity::Time).unwrap_or_else(|| panic!("{text}"));
            assert!((found / expected - 1.0).abs() < 1e-9, "{text}: {found}");
        }
        for text in ["Bulb", "bulb", "Time", "Auto", "", "x 200", "-1", "1/0", "429496.7295s", "nan", "inf"] {
            assert_eq!(parse(text, Quantity::Time), None, "{text}");
        }
        assert_eq!(parse("ISO 400", Quantity::Iso), Some(400.0));
        assert_eq!(parse("100", Quantity::Iso), Some(100.0));
        assert_eq!(parse("Auto", Quantity::Iso), None);
        for text in ["f/8", "F8.0", "8"] {
            assert_eq!(parse(text, Quantity::FNumber), Some(8.0), "{text}");
        }
        assert_eq!(parse("implicit auto", Quantity::FNumber), None);
        assert_eq!(parse("f/0", Quantity::FNumber), None, "a lens without contacts");
    }

    /// Each time of the series, as PTP cuts it off, comes back as itself.
    #[test]
    fn times_that_ptp_cut_off_are_found_again() {
        for n in [4u32, 5, 8, 13, 15, 30, 60, 125, 200, 640, 800, 1250, 1600, 3200, 8000] {
            let text = format!("{:.4}s", f64::from(10_000 / n) / 1e4);
            assert_eq!(parse(&text, Quantity::Time), Some(1.0 / f64::from(n)), "{text}");
        }
    }

    #[test]
    fn the_nearest_choice_is_by_ratio() {
        let times = widget("shutterspeed", "1/60", &["1/8000", "1/60", "1/50", "1", "30", "Bulb"]);
        let nearest_to = |wanted| nearest(&times, wanted, Quantity::Time).unwrap().words();
        assert_eq!(nearest_to(1.0 / 60.0), "1/60");
        assert_eq!(nearest_to(0.018), "1/60");
        assert_eq!(nearest_to(0.0185), "1/50");
        assert_eq!(nearest_to(100.0), "30");
        assert_eq!(nearest_to(1e-5), "1/8000");
        let slider = Widget { value: Value::Number(0.1), choices: Vec::new(), ..times };
        assert_eq!(nearest(&slider, 0.25, Quantity::Time), Some(Value::Number(0.25)));
        assert_eq!(nearest(&widget("iso", "Auto", &["Auto"]), 100.0, Quantity::Iso), None);
    }

    #[test]
    fn dials_are_found_by_their_names() {
        let mut nikon = vec![
            widget("shutterspeed", "0.0166s", &["0.0166s", "0.0020s"]),
            widget("shutterspeed2", "1/60", &["1/60", "1/500"]),
            widget("iso", "100", &["100", "200"]),
            widget("f-number", "f/8", &["f/8", "f/11"]),
            widget("imagequality", "NEF+Fine", &["NEF+Fine"]),
            widget("capturetarget", "Internal RAM", &["Internal RAM", "Memory card"]),
        ];
        let dials = Dials::of(&nikon);
        assert_eq!(dials.time.as_deref(), Some("shutterspeed2"));
        assert_eq!((dials.iso.as_deref(), dials.f_number.as_deref()), (Some("iso"), Some("f-number")));
        assert_eq!(dials.format.as_deref(), Some("imagequality"));
        nikon[1].readonly = true;
        assert_eq!(Dials::of(&nikon).time.as_deref(), Some("shutterspeed"));
        let manual =
            vec![widget("shutterspeed", "1/60", &["1/60"]), widget("aperture", "implicit auto", &["implicit auto"])];
        assert_eq!(Dials::of(&manual).f_number, None);
        assert_eq!(Dials::of(&manual).iso, None);
    }

    #[test]
    fn what_cameras_tell_of_themselves() {
        let with = |name: &str, value: &str| vec![widget(name, value, &[])];
        assert_eq!(is_manual(&with("expprogram", "M")), Some((true, "M".to_owned())));
        assert_eq!(is_manual(&with("autoexposuremode", "Manual")), Some((true, "Manual".to_owned())));
        assert_eq!(is_manual(&with("autoexposuremode", "AV")), Some((false, "AV".to_owned())));
        assert_eq!(is_manual(&[]), None);
        assert_eq!(battery(&with("batterylevel", "50%")), Some(50.0));
        assert_eq!(battery(&with("batterylevel", "Low")), Some(10.0));
        assert_eq!(battery(&with("batterylevel", "unknown value 0064")), None);
        assert!(chooses_iso(&with("isoauto", "On")) && chooses_iso(&with("iso", "Auto")));
        assert!(!chooses_iso(&with("isoauto", "Off")) && !chooses_iso(&with("iso", "100")));
    }
}
