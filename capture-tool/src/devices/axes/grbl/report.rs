//! What a line of GRBL 1.1 means. Lines that are damaged are [`Said::Other`]: they are never guessed at.

/// A line.
#[derive(Debug, Clone, PartialEq)]
pub enum Said {
    /// A line was taken, which is not: carried out.
    Ok,
    /// A line was not.
    Error(u32),
    /// It stopped by itself.
    Alarm(u32),
    /// The answer to `?`.
    Status(Status),
    /// It has just started.
    Banner(String),
    /// `$n=value`.
    Setting(u32, f64),
    /// Offsets of `$#`, as in `[G92:0.000,0.000,0.000]`.
    Offset(String, Vec<f64>),
    /// The answer to `$G`.
    Modes,
    /// Any other line.
    Other(String),
}

/// The answer to `?`.
#[derive(Debug, Clone, PartialEq)]
pub struct Status {
    /// What it does.
    pub state: State,
    /// Machine position, where that is what it reports.
    pub machine: Option<Vec<f64>>,
    /// Position in work coordinates, where that is.
    pub work: Option<Vec<f64>>,
    /// Machine less work coordinates: told now and then, and always after a change.
    pub offset: Option<Vec<f64>>,
}

/// What it does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum State {
    /// Nothing.
    Idle,
    /// Moves.
    Run,
    /// Was told to stop; 0: it has.
    Hold(u32),
    /// Moves by hand.
    Jog,
    /// Stopped by itself.
    Alarm,
    /// The door is open.
    Door,
    /// Tries G-code without moving.
    Check,
    /// Looks for its switches.
    Home,
    /// Switched its motors off.
    Sleep,
}

impl Said {
    /// Reads a line.
    pub fn of(line: &str) -> Self {
        Self::known(line).unwrap_or_else(|| Self::Other(line.to_owned()))
    }

    fn known(line: &str) -> Option<Self> {
        if line == "ok" {
            return Some(Self::Ok);
        }
        if let Some(code) = line.strip_prefix("error:") {
            return code.parse().ok().map(Self::Error);
        }
        if let Some(code) = line.strip_prefix("ALARM:") {
            return code.parse().ok().map(Self::Alarm);
        }
        // Also behind what a restart left on the line: to miss a restart is worse than to see one too many.
        if line.contains("Grbl") && line.contains("for help") {
            return Some(Self::Banner(line.to_owned()));
        }
        if let Some(inside) = line.strip_prefix('<').and_then(|rest| rest.strip_suffix('>')) {
            return status(inside).map(Self::Status);
        }
        if let Some(inside) = line.strip_prefix('[').and_then(|rest| rest.strip_suffix(']')) {
            let (name, rest) = inside.split_once(':')?;
            return match name {
                "GC" => Some(Self::Modes),
                "G54" | "G55" | "G56" | "G57" | "G58" | "G59" | "G28" | "G30" | "G92" => {
                    numbers(rest).map(|values| Self::Offset(name.to_owned(), values))
                }
                _ => None,
            };
        }
        let (number, value) = line.strip_prefix('$')?.split_once('=')?;
        Some(Self::Setting(number.parse().ok()?, value.parse().ok().filter(|v: &f64| v.is_finite())?))
    }
}

/// As in `Idle|MPos:0.000,0.000,0.000|FS:0,0|WCO:0.000,0.000,0.000`.
fn status(inside: &str) -> Option<Status> {
    let mut parts = inside.split('|');
    let (state, sub) = parts.next().map(|word| word.split_once(':').unwrap_or((word, "0")))?;
    let state = match state {
        "Idle" => State::Idle,
        "Run" => State::Run,
        "Hold" => State::Hold(sub.parse().ok()?),
        "Jog" => State::Jog,
        "Alarm" => State::Alarm,
        "Door" => State::Door,
        "Check" => State::Check,
        "Home" => State::Home,
        "Sleep" => State::Sleep,
        _ => return None,
    };
    let mut status = Status { state, machine: None, work: None, offset: None };
    for part in parts {
        let (name, values) = part.split_once(':')?;
        match name {
            "MPos" => status.machine = Some(numbers(values)?),
            "WPos" => status.work = Some(numbers(values)?),
            "WCO" => status.offset = Some(numbers(values)?),
            _ => {}
        }
    }
    (status.machine.is_some() || status.work.is_some()).then_some(status)
}

/// Three or more numbers between commas, each with its decimals: one that was cut short is another number.
fn numbers(text: &str) -> Option<Vec<f64>> {
    let number = |word: &str| -> Option<f64> {
        let (_, decimals) = word.split_once('.')?;
        let whole = decimals.len() == 3 || decimals.len() == 4;
        word.parse().ok().filter(|v: &f64| whole && v.is_finite())
    };
    let values: Option<Vec<f64>> = text.split(',').map(number).collect();
    values.filter(|values| values.len() >= 3)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_of_a_board_are_told_apart() {
        assert_eq!(Said::of("ok"), Said::Ok);
        assert_eq!(Said::of("error:9"), Said::Error(9));
        assert_eq!(Said::of("ALARM:1"), Said::Alarm(1));
        assert_eq!(Said::of("$100=8.889"), Said::Setting(100, 8.889));
        assert_eq!(Said::of("[GC:G0 G54 G17 G21 G90 G94 M5 M9 T0 F0 S0]"), Said::Modes);
        assert_eq!(Said::of("[G92:0.000,-1.500,92.500]"), Said::Offset("G92".to_owned(), vec![0.0, -1.5, 92.5]));
        for banner in [
            "Grbl 1.1h ['$' for help]",
            "\u{fffd}Grbl 3.7 [FluidNC v3.7 (wifi) '$' for help]",
            "GrblHAL 1.1f ['$' or '$HELP' for help]",
        ] {
            assert!(matches!(Said::of(banner), Said::Banner(_)), "{banner}");
        }
        let Said::Status(status) = Said::of("<Hold:0|WPos:1.000,2.000,3.000|Bf:15,128|FS:0,0|WCO:0.000,0.000,1.000>")
        else {
            panic!("no status")
        };
        assert_eq!((status.state, status.machine), (State::Hold(0), None));
        assert_eq!((status.work, status.offset), (Some(vec![1.0, 2.0, 3.0]), Some(vec![0.0, 0.0, 1.0])));
    }

    #[test]
    fn damaged_lines_are_not_guessed_at() {
        for line in [
            "o",
            "k",
            "okk",
            "OK",
            "error:",
            "error:x",
            "<Idle|MPos:0.000,0.0",
            "<Idle|MPos:0.000,0.000,0.0>",
            "<Idle>",
            "<Idl|MPos:0.000,0.000,0.000>",
            "<Idle|MPos:0.000,0.000>",
            "<Idle|MPos:0.000,NaN,0.000>",
            "Idle|MPos:0.000,0.000,0.000>",
            "<Idle|MPos:1.0<Idle|MPos:0.000,0.000,0.000>",
            "[G92:0.000,0.000]",
            "[MSG:Caution: Unlocked]",
            "$100=",
            "$x=1",
            "$1=inf",
            "",
            "Grbl 1.1h",
            "<Hold:|MPos:0.000,0.000,0.000>",
        ] {
            assert!(matches!(Said::of(line), Said::Other(_)), "{line}: {:?}", Said::of(line));
        }
    }
}
