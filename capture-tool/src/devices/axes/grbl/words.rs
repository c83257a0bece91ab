//! What GRBL's numbers mean (gnea/grbl 1.1, doc/csv: `alarm_codes_en_US.csv`, `error_codes_en_US.csv`).

/// An alarm in words.
pub fn alarm(code: u32) -> &'static str {
    match code {
        1 => "a limit switch was hit",
        2 => "a target lies outside the board's soft limits",
        3 => "it was reset in motion, and its position is lost",
        4 | 5 => "its probe failed",
        6 => "it was reset while homing",
        7 => "the safety door was opened while homing",
        8 => "a limit switch did not clear while homing",
        9 => "no limit switch was found while homing",
        10 => "a second limit switch was not found while homing",
        _ => "of a kind that is not known",
    }
}

/// An error in words.
pub fn error(code: u32) -> &'static str {
    match code {
        1 => "a letter was expected",
        2 => "a number has a bad form",
        3 => "a $ command is not known",
        4 => "a value is negative",
        5 => "homing is switched off ($22=0)",
        6 => "a step pulse is too short",
        7 => "its memory of settings failed",
        8 => "a $ command needs it idle",
        9 => "it is locked by an alarm or a jog",
        10 => "soft limits need homing",
        11 => "a line is too long",
        12 => "its step rate would be too high",
        13 => "the safety door is open",
        14 => "a start-up line is too long",
        15 => "a jog would leave its travel",
        16 => "a jog has a bad form",
        17 => "laser mode needs PWM",
        20 => "a G-code is not known",
        21 => "two G-codes exclude each other",
        22 => "no feed rate is set",
        23..=39 => "a G-code line is not valid",
        _ => "of a kind that is not known",
    }
}

/// May the same line be taken when it is sent again? So it is where a byte was damaged on its way.
pub fn may_be_noise(code: u32) -> bool {
    matches!(code, 1..=4 | 8 | 11 | 14 | 16 | 20..=39)
}
