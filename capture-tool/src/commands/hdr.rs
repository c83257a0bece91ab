//! `relume hdr`: a bracket of photographs -> one picture of light.

mod report;
mod times;

use std::path::{Path, PathBuf};

use anyhow::bail;
use clap::{Args, ValueEnum};
use relume_core::calibrate::black::Blacks;
use relume_core::files;
use relume_core::hdr::{
    self, Bracket, Curve, Exposure, Noise, Options, Patches, Relative, Response, Shot, Survey, align,
};
use relume_core::image::{self, EncodeOptions, SampleType};

use super::{note, values};
use crate::progress::{Progress, Unit};
use report::Report;
use times::Times;

const EXAMPLES: &str = "\
Examples:
  relume hdr IMG_1.jpg IMG_2.jpg IMG_3.jpg -o window.exr --recover-response --save-response camera.txt
  relume hdr IMG_1.jpg IMG_2.jpg IMG_3.jpg -o window.exr --response camera.txt --align --report window.json
  relume hdr a.tif b.tif c.tif -o ball.exr --encoding linear --times 1/60,1/15,0.25 --reference middle
  relume hdr a.png b.png c.png -o ball.exr --times 0.1,0.16,0.32 --black cap.png --recover-response --report ball.json

Scale: a photograph of relative exposure s = time x (ISO / 100) / F-number^2 shows light E as x = E s, where the white
code is 1 (with a response: where code 128 is 0.2158605, as in sRGB). OUT holds E = x / s, so brackets of one camera
share one scale, whatever their exposures. ISO and F-number count when every photograph has them in its EXIF data; with
--times s is the time alone. With --reference N, OUT is as bright as photograph N instead.

Weights: inverse variance by photons, reading and rounding. Clipped and black values are dropped, with a soft edge.
Where every photograph is clipped the shortest is used, where all are dark the longest, and both are counted.

Dark level: cameras add light to what they code (dark current, flare, an offset that keeps noise from being cut at zero).
--black takes it off: the light of the level is subtracted from that of each code, and negative values are kept.

Response of 16-bit files: recovered from small patches, with the dark level and the sensor's noise. Exposures that are all one
or two stops apart leave a ripple in it; steps that differ, such as 2/3 and 1 stop in turn, do not.

Response file: comments behind #, then a line for each 8-bit code: CODE RED GREEN BLUE, the linear light of that code.";

/// Raw flags.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// Photographs of one scene at different exposures, in any order: JPEG, PNG, TIFF, EXR, HDR; raw files (DNG, CR2, NEF,
    /// ARW...) where the feature `raw` is built in.
    #[arg(required = true)]
    images: Vec<PathBuf>,
    /// The picture to write, linear: .exr, .hdr or .tif.
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
    /// The camera's response, as --save-response wrote it; for photographs of integer codes.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["recover_response", "encoding"])]
    response: Option<PathBuf>,
    /// Recover the camera's response from these photographs (Debevec and Malik 1997); for photographs of integer codes.
    #[arg(long, conflicts_with = "encoding")]
    recover_response: bool,
    /// Write the recovered response to this text file.
    #[arg(long, value_name = "FILE", requires = "recover_response")]
    save_response: Option<PathBuf>,
    /// Smoothness of the recovered response, of 8-bit photographs; larger is smoother.
    #[arg(long, value_name = "LAMBDA", requires = "recover_response", value_parser = values::positive,
          default_value_t = hdr::LAMBDA as f32)]
    smoothness: f32,
    /// How codes are encoded, without a response: auto takes 8- and 16-bit files for sRGB and float files for linear.
    #[arg(long, value_enum, default_value_t = EncodingChoice::Auto)]
    encoding: EncodingChoice,
    /// Exposure times instead of EXIF: a list in the order of the photographs (1/60,1/15,0.25), or a text file with a line
    /// for each, TIME or NAME TIME.
    #[arg(long, value_name = "LIST|FILE", allow_hyphen_values = true)]
    times: Option<String>,
    /// Move photographs over each other first (handheld brackets): median threshold bitmaps (Ward 2003), whole pixels.
    #[arg(long)]
    align: bool,
    /// Make OUT as bright as photograph N, counted from 1, or as the middle exposure.
    #[arg(long, value_name = "N|middle")]
    reference: Option<Reference>,
    /// Samples from here on are clipped, where the white code is 1. Without it the level is read off the photographs:
    /// clipped values pile up at one code.
    #[arg(long, value_name = "LEVEL", value_parser = values::positive)]
    clip: Option<f32>,
    /// The dark level to subtract: a photograph taken with the cap on, of the same camera, or a number where the white
    /// code is 1.
    #[arg(long, value_name = "IMG|LEVEL")]
    black: Option<BlackChoice>,
    /// Electrons of the sensor at white, at ISO 100.
    #[arg(long, value_name = "ELECTRONS", value_parser = values::positive,
          default_value_t = Noise::default().full_well_e as f32)]
    full_well: f32,
    /// Noise of reading a pixel, electrons.
    #[arg(long, value_name = "ELECTRONS", value_parser = values::positive,
          default_value_t = Noise::default().read_e as f32)]
    read_noise: f32,
    /// Write what is printed, and more, as JSON.
    #[arg(long, value_name = "JSON")]
    report: Option<PathBuf>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum EncodingChoice {
    /// By file type.
    Auto,
    /// The sRGB curve.
    Srgb,
    /// Proportional to light.
    Linear,
}

/// Which photograph the result is as bright as.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Reference {
    Photograph(usize),
    Middle,
}

impl std::str::FromStr for Reference {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.parse() {
            Ok(number) if number > 0 => Ok(Self::Photograph(number)),
            _ if text == "middle" => Ok(Self::Middle),
            _ => Err("neither a number counted from 1 nor `middle`".to_owned()),
        }
    }
}

/// Where the dark level comes from.
#[derive(Debug, Clone, PartialEq)]
enum BlackChoice {
    Level(f32),
    Photograph(PathBuf),
}

impl std::str::FromStr for BlackChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match values::finite(text) {
            Ok(level) if (0.0..0.5).contains(&level) => Ok(Self::Level(level as f32)),
            Ok(_) => Err("a dark level is from 0 to below 0.5, where white is 1".to_owned()),
            // A comma in a number gets its hint; what has a letter is a file.
            Err(hint) if !text.contains(char::is_alphabetic) => Err(hint),
            Err(_) => Ok(Self::Photograph(PathBuf::from(text))),
        }
    }
}

/// How light is found from codes.
#[derive(Debug, Clone, PartialEq)]
enum CurvePlan {
    Encoding(EncodingChoice),
    Response(Response),
    Recover { lambda: f64, save: Option<PathBuf> },
}

/// Checked flags.
#[derive(Debug, Clone, PartialEq)]
struct Plan {
    images: Vec<PathBuf>,
    names: Vec<String>,
    exposures: Vec<Exposure>,
    from_exif: bool,
    relative: Relative,
    output: PathBuf,
    curve: CurvePlan,
    align: bool,
    reference: Option<usize>,
    clip: Option<f32>,
    black: Option<BlackChoice>,
    noise: Noise,
    report: Option<PathBuf>,
}

impl Arguments {
    /// Merges and writes.
    pub fn run(self) -> anyhow::Result<String> {
        self.plan()?.carry_out()
    }

    /// Refuses what can be known to fail before the work.
    fn plan(self) -> anyhow::Result<Plan> {
        image::check_output(&self.output)?;
        for path in [&self.save_response, &self.report].into_iter().flatten() {
            files::check_folder(path)?;
        }
        if let Some(BlackChoice::Photograph(path)) = &self.black {
            // A wrong name is wrong before the work.
            image::probe_size(path)?;
        }
        if let [only] = &self.images[..] {
            bail!("{} is one photograph; a bracket has at least two, at different exposures", only.display());
        }
        let times = self.times.as_deref().map(Times::parse).transpose()?;
        let exposures = match &times {
            Some(times) => times.of(&self.images)?,
            None => {
                self.images.iter().map(|path| Exposure::read(path)).collect::<Result<_, _>>().map_err(with_times)?
            }
        };
        let names: Vec<String> = self.images.iter().map(|path| path.display().to_string()).collect();
        let relative = hdr::relative(&exposures, &names)?;
        let reference = reference(self.reference, &relative.values)?;
        let curve = match (&self.response, self.recover_response) {
            (Some(path), _) => CurvePlan::Response(Response::read(path)?),
            (None, true) => CurvePlan::Recover { lambda: f64::from(self.smoothness), save: self.save_response },
            (None, false) => CurvePlan::Encoding(self.encoding),
        };
        Ok(Plan {
            from_exif: times.is_none(),
            images: self.images,
            names,
            exposures,
            relative,
            output: self.output,
            curve,
            align: self.align,
            reference,
            clip: self.clip,
            black: self.black,
            noise: Noise { full_well_e: f64::from(self.full_well), read_e: f64::from(self.read_noise) },
            report: self.report,
        })
    }
}

/// Names the way out of missing EXIF data.
fn with_times(error: relume_core::Error) -> anyhow::Error {
    let advice = "--times 1/60,1/15,0.25 (or a file) gives the exposure times";
    match error {
        relume_core::Error::Invalid { place, found, .. } => anyhow::anyhow!("{place}: found {found}; {advice}"),
        other => other.into(),
    }
}

/// The index of the photograph that gives the scale.
fn reference(wanted: Option<Reference>, exposures: &[f64]) -> anyhow::Result<Option<usize>> {
    match wanted {
        Some(Reference::Photograph(number)) if number > exposures.len() => {
            bail!("--reference {number}: there are {} photographs", exposures.len())
        }
        Some(Reference::Photograph(number)) => Ok(Some(number - 1)),
        Some(Reference::Middle) => Ok(Some(middle(exposures))),
        None => Ok(None),
    }
}

/// The photograph of middle exposure; of an even number the longer one of the two.
fn middle(exposures: &[f64]) -> usize {
    let mut order: Vec<usize> = (0..exposures.len()).collect();
    order.sort_by(|a, b| exposures[*a].total_cmp(&exposures[*b]));
    order[order.len() / 2]
}

impl Plan {
    fn carry_out(&self) -> anyhow::Result<String> {
        let mut bracket = Bracket::open(&self.images)?;
        let sample_type = bracket.sample_type();
        let steps = self.images.len() as u64 * (3 + u64::from(self.align));
        let (mut progress, mut done) = (Progress::new("merging", Unit::Steps), 0);
        let mut load = |index: usize| {
            progress.step(done, steps)?;
            done += 1;
            bracket.load(index)
        };
        let order = self.order();
        let offsets = if self.align { self.offsets(&order, &mut load)? } else { vec![[0; 2]; self.images.len()] };

        let looked = Looked::at(&order, &offsets, sample_type, &mut load)?;
        let found_clip = looked.survey.clip();
        let clip = self.clip.map_or(found_clip, |level| [Some(level); 3]);
        let levels = clip.map(|level| level.unwrap_or(f32::INFINITY));
        let shots: Vec<Shot> = (0..self.images.len())
            .map(|i| Shot {
                exposure: self.relative.values[i],
                iso: self.exposures[i].iso.unwrap_or(100.0),
                offset: offsets[i],
            })
            .collect();
        let black = self.black(sample_type)?;
        let ordered: Vec<Shot> = order.iter().map(|i| shots[*i]).collect();
        let known = hdr::Known { shots: &ordered, clip: levels, black, noise: self.noise };
        let (curve, recovery) = self.curve(&looked, &known, sample_type)?;

        let reference = self.reference.map_or(1.0, |i| self.relative.values[i]);
        let options = Options { curve, sample_type, clip: levels, noise: self.noise, black, reference };
        let mut merged = hdr::merge(&shots, &options, &mut load)?;
        if let Some(matrix) = bracket.to_rec709() {
            hdr::apply_matrix(&mut merged.image, &matrix);
        }

        let report = Report::new(self, &options, &shots, clip, recovery, &merged);
        image::write(&self.output, &merged.image, EncodeOptions::default())?;
        if let Some(path) = &self.report {
            report.write(path)?;
        }
        self.tell_what_is_odd(sample_type);
        report.doubts().iter().for_each(|line| note(line));
        Ok(report.text())
    }

    fn tell_what_is_odd(&self, sample_type: SampleType) {
        let eight_bits = matches!(sample_type, SampleType::Jpeg | SampleType::U8);
        if eight_bits && self.curve == CurvePlan::Encoding(EncodingChoice::Auto) {
            note(
                "8-bit photographs are taken for sRGB, which few cameras keep to: --recover-response finds their own curve",
            );
        }
        let others = (self.exposures.iter().any(|e| e.iso.is_some()) && !self.relative.with_iso)
            || (self.exposures.iter().any(|e| e.f_number.is_some()) && !self.relative.with_f_number);
        if others {
            note("ISO speed or F-number is missing in some photographs, and left out for all");
        }
    }

    /// Indices by exposure.
    fn order(&self) -> Vec<usize> {
        let mut order: Vec<usize> = (0..self.images.len()).collect();
        order.sort_by(|a, b| self.relative.values[*a].total_cmp(&self.relative.values[*b]));
        order
    }

    /// Shifts against the middle exposure, summed over neighbours in exposure.
    fn offsets(&self, order: &[usize], load: Load) -> anyhow::Result<Vec<[i32; 2]>> {
        let mut offsets = vec![[0i32; 2]; order.len()];
        let mut last: Option<(usize, align::Pyramid)> = None;
        for &index in order {
            let image = load(index)?;
            let linear = matches!(self.curve, CurvePlan::Encoding(EncodingChoice::Linear));
            let pyramid = align::Pyramid::new(&image, linear);
            if let Some((before, pyramid_before)) = &last {
                let [dx, dy] = align::shift(pyramid_before, &pyramid).unwrap_or_else(|| {
                    let (before, this) = (&self.names[*before], &self.names[index]);
                    note(&format!("{this} and {before} show too little in common to be aligned: taken as not moved"));
                    [0, 0]
                });
                offsets[index] = [offsets[*before][0] + dx, offsets[*before][1] + dy];
            }
            last = Some((index, pyramid));
        }
        let [x, y] = offsets[self.reference.unwrap_or_else(|| middle(&self.relative.values))];
        Ok(offsets.iter().map(|o| [o[0] - x, o[1] - y]).collect())
    }

    /// The code of no light, each channel.
    fn black(&self, sample_type: SampleType) -> anyhow::Result<[f32; 3]> {
        let path = match &self.black {
            None => return Ok([0.0; 3]),
            Some(BlackChoice::Level(level)) => return Ok([*level; 3]),
            Some(BlackChoice::Photograph(path)) => path,
        };
        let (codes, black_type) = image::read_codes(path)?;
        if black_type != sample_type {
            bail!("{}: its samples are not of the type of the photographs'; take all with one camera", path.display());
        }
        // In codes: without light the curve, which may not be known yet, is straight over what noise spans.
        let mut blacks = Blacks::new(Curve::Linear, sample_type);
        blacks.add(&codes.into_rgb(), 1.0)?;
        let level = blacks.finish()?.level;
        if level.iter().any(|v| *v > BRIGHT_BLACK) {
            note(&format!("{} is bright for a black photograph: levels {level:.3?} of white", path.display()));
        }
        Ok(level)
    }

    fn curve(
        &self,
        looked: &Looked,
        known: &hdr::Known,
        sample_type: SampleType,
    ) -> anyhow::Result<(Curve, Option<hdr::RecoveryReport>)> {
        match &self.curve {
            CurvePlan::Encoding(EncodingChoice::Linear) => Ok((Curve::Linear, None)),
            CurvePlan::Encoding(EncodingChoice::Srgb) => Ok((Curve::Srgb, None)),
            CurvePlan::Encoding(EncodingChoice::Auto) if sample_type == SampleType::Float => Ok((Curve::Linear, None)),
            CurvePlan::Encoding(EncodingChoice::Auto) => Ok((Curve::Srgb, None)),
            _ if sample_type == SampleType::Float => {
                bail!(
                    "{}: a response is for photographs of integer codes; say --encoding linear or --encoding srgb for this one",
                    self.names[0]
                )
            }
            CurvePlan::Response(response) => Ok((Curve::Response(response.clone()), None)),
            CurvePlan::Recover { lambda, save } => {
                let exposures: Vec<f64> = known.shots.iter().map(|s| s.exposure).collect();
                let recovered = match &looked.patches {
                    Some(patches) => hdr::recover_deep(&patches.samples(), known)?,
                    None => hdr::recover(&looked.survey.samples(), &exposures, known.clip, *lambda)?,
                };
                if let Some(path) = save {
                    recovered.response.write(path)?;
                }
                Ok((Curve::Response(recovered.response), Some(recovered.report)))
            }
        }
    }
}

/// A black photograph above this share of white has light in it: dark levels of cameras lie below a tenth, a film's curve
/// lifts them.
const BRIGHT_BLACK: f32 = 0.25;

/// What one look at each photograph gives.
struct Looked {
    survey: Survey,
    /// Of codes deeper than 8 bits.
    patches: Option<Patches>,
}

/// Loads a photograph by index, and counts.
type Load<'a> = &'a mut dyn FnMut(usize) -> relume_core::Result<std::sync::Arc<image::Image>>;

impl Looked {
    fn at(order: &[usize], offsets: &[[i32; 2]], sample_type: SampleType, load: Load) -> anyhow::Result<Self> {
        let mut looked: Option<Self> = None;
        for &index in order {
            let image = load(index)?;
            let (w, h) = image.size();
            let looked = looked.get_or_insert_with(|| Self {
                survey: Survey::new(w, h, sample_type),
                patches: (sample_type == SampleType::U16).then(|| Patches::new(w, h)),
            });
            looked.survey.add(&image, offsets[index]);
            looked.patches.iter_mut().for_each(|patches| patches.add(&image, offsets[index]));
        }
        looked.ok_or_else(|| anyhow::anyhow!("no photograph"))
    }
}

/// The name of a file alone.
fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::testing;

    fn parse(line: &str) -> Result<Arguments, clap::Error> {
        testing::parse(line)
    }

    #[test]
    fn flags_reach_the_plan() {
        let line = "hdr a.tif b.tif c.tif -o out.exr --times 1/60,4,0.25 --encoding linear --align --reference middle \
                    --clip 0.9 --full-well 5000 --read-noise 2 --black 0.016";
        let plan = parse(line).unwrap().plan().unwrap();
        assert_eq!(plan.relative.values, [1.0 / 60.0, 4.0, 0.25]);
        assert_eq!((plan.reference, plan.clip, plan.align, plan.from_exif), (Some(2), Some(0.9), true, false));
        assert_eq!(plan.curve, CurvePlan::Encoding(EncodingChoice::Linear));
        assert_eq!(plan.noise, Noise { full_well_e: 5000.0, read_e: 2.0 });
        assert_eq!(plan.black, Some(BlackChoice::Level(0.016)));
        assert_eq!(plan.order(), [0, 2, 1]);
    }

    #[test]
    fn wrong_usage_is_refused_by_the_parser() {
        for line in [
            "hdr -o out.exr",
            "hdr a.jpg b.jpg",
            "hdr a.jpg b.jpg -o out.exr --response r.txt --recover-response",
            "hdr a.jpg b.jpg -o out.exr --save-response r.txt",
            "hdr a.jpg b.jpg -o out.exr --recover-response --encoding srgb",
            "hdr a.jpg b.jpg -o out.exr --reference 0",
            "hdr a.jpg b.jpg -o out.exr --clip 0",
            "hdr a.jpg b.jpg -o out.exr --read-noise nan",
            "hdr a.jpg b.jpg -o out.exr --black 0,02",
            "hdr a.jpg b.jpg -o out.exr --black 0.7",
            "hdr a.jpg b.jpg -o out.exr --black -0.1",
        ] {
            assert!(parse(line).is_err(), "{line}");
        }
    }

    #[test]
    fn bad_plans_say_what_to_do() {
        for (line, words) in [
            ("hdr a.jpg -o out.exr --times 1", "a.jpg is one photograph"),
            ("hdr a.jpg b.jpg -o out.bmp --times 1,2", ".bmp"),
            ("hdr a.jpg b.jpg -o out.exr --times 1,2,3", "3 times for 2 photographs"),
            ("hdr a.jpg b.jpg -o out.exr --times 1,0", "`0` is not a positive time"),
            ("hdr a.jpg b.jpg -o out.exr --times -1,2", "`-1` is not a positive time"),
            ("hdr a.jpg b.jpg -o out.exr --times 1,NaN", "`NaN` is not a positive time"),
            ("hdr a.jpg b.jpg -o out.exr --times absent.txt", "absent.txt"),
            ("hdr a.jpg b.jpg -o out.exr --times 1,2 --reference 3", "there are 2 photographs"),
            ("hdr a.jpg b.jpg -o out.exr --times 1,2 --report absent/r.json", "does not exist"),
            ("hdr absent.jpg b.jpg -o out.exr", "absent.jpg"),
            ("hdr a.jpg b.jpg -o out.exr --times 1,2 --black cap.png", "cap.png"),
        ] {
            let message = format!("{:#}", parse(line).unwrap().plan().unwrap_err());
            assert!(message.contains(words), "{line}: {message}");
        }
    }
}
