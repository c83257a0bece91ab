//! `relume hdr`: a bracket of photographs -> one picture of light.

mod report;
mod times;

use std::path::{Path, PathBuf};

use anyhow::bail;
use clap::{Args, ValueEnum};
use relume_core::files;
use relume_core::hdr::{self, Bracket, Curve, Exposure, Noise, Options, Relative, Response, Shot, Survey, align};
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

Scale: a photograph of relative exposure s = time x (ISO / 100) / F-number^2 shows light E as x = E s, where the white
code is 1 (with a response: where code 128 is 0.2158605, as in sRGB). OUT holds E = x / s, so brackets of one camera
share one scale, whatever their exposures. ISO and F-number count when every photograph has them in its EXIF data; with
--times s is the time alone. With --reference N, OUT is as bright as photograph N instead.

Weights: inverse variance by photons, reading and rounding. Clipped and black values are dropped, with a soft edge.
Where every photograph is clipped the shortest is used, where all are dark the longest, and both are counted.

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
    /// The camera's response, as --save-response wrote it; for 8-bit photographs.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["recover_response", "encoding"])]
    response: Option<PathBuf>,
    /// Recover the camera's response from these photographs (Debevec and Malik 1997); for 8-bit photographs.
    #[arg(long, conflicts_with = "encoding")]
    recover_response: bool,
    /// Write the recovered response to this text file.
    #[arg(long, value_name = "FILE", requires = "recover_response")]
    save_response: Option<PathBuf>,
    /// Smoothness of the recovered response; larger is smoother.
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

        let survey = survey(&order, &offsets, sample_type, &mut load)?;
        let found_clip = survey.clip();
        let clip = self.clip.map_or(found_clip, |level| [Some(level); 3]);
        let levels = clip.map(|level| level.unwrap_or(f32::INFINITY));
        let (curve, recovery) = self.curve(&survey, &order, levels, sample_type)?;

        let shots: Vec<Shot> = (0..self.images.len())
            .map(|i| Shot {
                exposure: self.relative.values[i],
                iso: self.exposures[i].iso.unwrap_or(100.0),
                offset: offsets[i],
            })
            .collect();
        let reference = self.reference.map_or(1.0, |i| self.relative.values[i]);
        let options = Options { clip: levels, noise: self.noise, reference, ..Options::new(curve, sample_type) };
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

    fn curve(
        &self,
        survey: &Survey,
        order: &[usize],
        clip: [f32; 3],
        sample_type: SampleType,
    ) -> anyhow::Result<(Curve, Option<hdr::RecoveryReport>)> {
        match &self.curve {
            CurvePlan::Encoding(EncodingChoice::Linear) => Ok((Curve::Linear, None)),
            CurvePlan::Encoding(EncodingChoice::Srgb) => Ok((Curve::Srgb, None)),
            CurvePlan::Encoding(EncodingChoice::Auto) if sample_type == SampleType::Float => Ok((Curve::Linear, None)),
            CurvePlan::Encoding(EncodingChoice::Auto) => Ok((Curve::Srgb, None)),
            _ if !matches!(sample_type, SampleType::Jpeg | SampleType::U8) => {
                bail!(
                    "{}: a response is for 8-bit photographs; say --encoding linear or --encoding srgb for this one",
                    self.names[0]
                )
            }
            CurvePlan::Response(response) => Ok((Curve::Response(response.clone()), None)),
            CurvePlan::Recover { lambda, save } => {
                let exposures: Vec<f64> = order.iter().map(|i| self.relative.values[*i]).collect();
                let recovered = hdr::recover(&survey.samples(), &exposures, clip, *lambda)?;
                if let Some(path) = save {
                    recovered.response.write(path)?;
                }
                Ok((Curve::Response(recovered.response), Some(recovered.report)))
            }
        }
    }
}

/// Loads a photograph by index, and counts.
type Load<'a> = &'a mut dyn FnMut(usize) -> relume_core::Result<std::sync::Arc<image::Image>>;

fn survey(order: &[usize], offsets: &[[i32; 2]], sample_type: SampleType, load: Load) -> anyhow::Result<Survey> {
    let mut survey: Option<Survey> = None;
    for &index in order {
        let image = load(index)?;
        let survey = survey.get_or_insert_with(|| Survey::new(image.width(), image.height(), sample_type));
        survey.add(&image, offsets[index]);
    }
    survey.ok_or_else(|| anyhow::anyhow!("no photograph"))
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
                    --clip 0.9 --full-well 5000 --read-noise 2";
        let plan = parse(line).unwrap().plan().unwrap();
        assert_eq!(plan.relative.values, [1.0 / 60.0, 4.0, 0.25]);
        assert_eq!((plan.reference, plan.clip, plan.align, plan.from_exif), (Some(2), Some(0.9), true, false));
        assert_eq!(plan.curve, CurvePlan::Encoding(EncodingChoice::Linear));
        assert_eq!(plan.noise, Noise { full_well_e: 5000.0, read_e: 2.0 });
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
        ] {
            let message = format!("{:#}", parse(line).unwrap().plan().unwrap_err());
            assert!(message.contains(words), "{line}: {message}");
        }
    }
}
