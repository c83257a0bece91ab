//! What is said of a merge, as text and as JSON.

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;

use relume_core::hdr::{self, Curve, Merged, Options, RecoveryReport, Shot};
use relume_core::{Error, files};
use serde::Serialize;

use super::Plan;

/// A photograph this far off the merged picture has a wrong time, or the response is wrong: cameras keep their times to some
/// tenth of a stop, nominal times (1/60 for 1/64) are off by another tenth.
const DOUBTFUL_EV: f32 = 0.35;
/// Shares from here on are worth a note.
const MANY: f64 = 0.001;

/// All there is to say.
#[derive(Debug, Serialize)]
pub(super) struct Report {
    output: String,
    width: usize,
    height: usize,
    /// `exif` or `list`.
    exposures: &'static str,
    /// What the relative exposures were made of.
    formula: &'static str,
    /// Pixel value 1 is the light that gives white (response: its anchor's scale) at this relative exposure.
    reference_exposure: f64,
    /// `linear`, `srgb`, `response` or `recovered response`.
    curve: &'static str,
    response: Option<RecoveryReport>,
    /// Samples from here on count as clipped, red, green, blue; null where nothing piles up.
    clip: [Option<f32>; 3],
    /// Code of no light, red, green, blue; zeros where nothing is subtracted.
    black: [f32; 3],
    full_well_e: f64,
    read_e: f64,
    photographs: Vec<Photograph>,
    clipped_everywhere: hdr::Shares,
    dark_everywhere: hdr::Shares,
    /// Relative standard deviation by the noise model.
    noise_median: f32,
    noise_percentile_95: f32,
}

#[derive(Debug, Serialize)]
struct Photograph {
    file: String,
    time_s: f64,
    iso: Option<f64>,
    f_number: Option<f64>,
    exposure: f64,
    offset: [i32; 2],
    #[serde(flatten)]
    usage: hdr::Use,
}

impl Report {
    pub(super) fn new(
        plan: &Plan,
        options: &Options,
        shots: &[Shot],
        clip: [Option<f32>; 3],
        response: Option<RecoveryReport>,
        merged: &Merged,
    ) -> Self {
        let photograph = |i: usize| Photograph {
            file: plan.names[i].clone(),
            time_s: plan.exposures[i].time_s,
            iso: plan.exposures[i].iso,
            f_number: plan.exposures[i].f_number,
            exposure: shots[i].exposure,
            offset: shots[i].offset,
            usage: merged.report.photographs[i],
        };
        Self {
            output: plan.output.display().to_string(),
            width: merged.image.width(),
            height: merged.image.height(),
            exposures: if plan.from_exif { "exif" } else { "list" },
            formula: match (plan.relative.with_iso, plan.relative.with_f_number) {
                (true, true) => "time x ISO/100 / F-number^2",
                (true, false) => "time x ISO/100",
                (false, true) => "time / F-number^2",
                (false, false) => "time",
            },
            reference_exposure: options.reference,
            curve: match (&options.curve, &response) {
                (Curve::Linear, _) => "linear",
                (Curve::Srgb, _) => "srgb",
                (Curve::Response(_), None) => "response",
                (Curve::Response(_), Some(_)) => "recovered response",
            },
            response,
            clip,
            black: options.black,
            full_well_e: options.noise.full_well_e,
            read_e: options.noise.read_e,
            photographs: (0..shots.len()).map(photograph).collect(),
            clipped_everywhere: merged.report.clipped_everywhere,
            dark_everywhere: merged.report.dark_everywhere,
            noise_median: merged.report.noise[0],
            noise_percentile_95: merged.report.noise[1],
        }
    }

    pub(super) fn write(&self, path: &Path) -> anyhow::Result<()> {
        let text = serde_json::to_string_pretty(self)? + "\n";
        files::write_whole(path, |out| out.write_all(text.as_bytes()).map_err(|e| Error::io("write", path, e)))?;
        Ok(())
    }

    /// What the person should look at.
    pub(super) fn doubts(&self) -> Vec<String> {
        let mut doubts: Vec<String> = self.response.iter().flat_map(|r| r.doubts.clone()).collect();
        for photograph in &self.photographs {
            match photograph.usage.deviation_ev {
                Some(ev) if ev.abs() > DOUBTFUL_EV => doubts.push(format!(
                    "{} is {:.2} stops {} than the others make expect: its exposure time or the response is wrong",
                    photograph.file,
                    ev.abs(),
                    if ev > 0.0 { "brighter" } else { "darker" }
                )),
                None => doubts.push(format!("{} adds nothing: all of it is clipped or dark", photograph.file)),
                _ => {}
            }
        }
        if self.clipped_everywhere.any >= MANY {
            doubts.push("some pixels are clipped in every photograph: a shorter exposure would hold them".to_owned());
        }
        doubts
    }

    pub(super) fn text(&self) -> String {
        let mut text = format!(
            "{}: {} x {} pixels of {} photographs, {}\n",
            self.output,
            self.width,
            self.height,
            self.photographs.len(),
            self.curve
        );
        let source = if self.exposures == "exif" { "EXIF" } else { "the given times" };
        // Writing to a String cannot fail.
        let _ = writeln!(
            text,
            "exposures from {source}: {}; pixel value 1 is white at {}",
            self.formula,
            number(self.reference_exposure)
        );
        if let Some(r) = &self.response {
            let [red, green, blue] = r.residual_ev;
            let _ = writeln!(
                text,
                "response from {} places; they disagree by {red:.3}, {green:.3}, {blue:.3} stops (R, G, B, rms)",
                r.samples
            );
            if r.codes_made_monotone != [0; 3] {
                let [red, green, blue] = r.codes_made_monotone;
                let _ = writeln!(text, "made to rise by isotonic regression: {red}, {green}, {blue} of 256 codes");
            }
        }
        if self.black != [0.0; 3] {
            let [red, green, blue] = self.black.map(|v| 100.0 * v);
            let _ = writeln!(text, "dark level subtracted: {red:.2}, {green:.2}, {blue:.2} % of the white code");
        }
        self.table(&mut text);
        let percent = |share: f64| format!("{:.3} %", 100.0 * share);
        let _ = writeln!(
            text,
            "clipped everywhere: {} of the pixels (the shortest is used)",
            percent(self.clipped_everywhere.any)
        );
        let _ = writeln!(
            text,
            "dark everywhere: {} of the pixels (the longest is used)",
            percent(self.dark_everywhere.any)
        );
        let (median, most) = (f64::from(self.noise_median), f64::from(self.noise_percentile_95));
        let _ =
            writeln!(text, "estimated noise: {} median, {} for 95 % of the samples", percent(median), percent(most));
        text
    }

    fn table(&self, text: &mut String) {
        let width = self.photographs.iter().map(|p| p.file.chars().count()).max().unwrap_or(0).max(10);
        let shifted = self.photographs.iter().any(|p| p.offset != [0, 0]);
        let _ = write!(
            text,
            "{:width$}  {:>9}  {:>9}  {:>6}  {:>7}  {:>6}  {:>8}",
            "photograph", "time", "exposure", "used", "clipped", "dark", "off by"
        );
        let _ = writeln!(text, "{}", if shifted { "  shift" } else { "" });
        for p in &self.photographs {
            let share = |v: f64| format!("{:.1} %", 100.0 * v);
            let off = p.usage.deviation_ev.map_or("-".to_owned(), |ev| format!("{ev:+.2} EV"));
            let _ = write!(
                text,
                "{:width$}  {:>9}  {:>9}  {:>6}  {:>7}  {:>6}  {:>8}",
                p.file,
                time(p.time_s),
                number(p.exposure),
                share(p.usage.used),
                share(p.usage.clipped),
                share(p.usage.dark),
                off
            );
            let _ = writeln!(
                text,
                "{}",
                if shifted { format!("  {:+},{:+}", p.offset[0], p.offset[1]) } else { String::new() }
            );
        }
    }
}

/// A time as cameras show it.
fn time(time_s: f64) -> String {
    let inverse = 1.0 / time_s;
    if time_s < 0.3 && (inverse - inverse.round()).abs() < 0.01 * inverse {
        format!("1/{} s", inverse.round())
    } else {
        format!("{} s", number(time_s))
    }
}

/// Four digits.
fn number(value: f64) -> String {
    if (1e-3..1e5).contains(&value) {
        let digits = (3 - value.log10().floor() as i32).max(0) as usize;
        let text = format!("{value:.digits$}");
        if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
    } else {
        format!("{value:.3e}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short() {
        let shown = [1.0 / 60.0, 0.25, 2.0, 1.5, 30.0, 0.001].map(time);
        assert_eq!(shown, ["1/60 s", "1/4 s", "2 s", "1.5 s", "30 s", "1/1000 s"]);
        assert_eq!([1.0, 0.0123456, 12_345.6, 1e-9].map(number), ["1", "0.01235", "12346", "1.000e-9"]);
    }
}
