//! A whole stage capture with real drivers, to a packed field: GRBL and DMX over pseudo-terminals and a camera over PTP, all of them in
//! software, against the same stage computed outright.
//!
//! What may differ is what a JPEG does to a photograph: eight bits, and what its compression loses. How much that is is found by
//! sending the computed photographs through the same JPEG.

use std::fs;
use std::io::Cursor;
use std::path::{Path, PathBuf};

use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageFormat};
use relume_core::image::{Encoding, Image, read, srgb};
use relume_tests::camera::{plug_in, plugin};

use super::capture::Capture;
use super::cli::succeed;
use super::simulated::{Simulated, photographs};

/// 12 lamps at 4 stops. White paper facing a lamp is at 0.3 of white.
const STAGE: &str = r#"
version = 1
name = "Stage of 12 lamps x 4 stops"
kind = "stage"
[stage.lamps]
layout = "arc"
latitudes = 12
longitudes = 4
[camera]
times_s = [0.05]
limits_s = [0.0001, 1.0]
f_number = 8.0
patience_s = 5
response = "RESPONSE"
[virtual]
width = 48
height = 36
samples = 4
irradiance = 1200.0
[virtual.sensor]
full_well_e = 1e9
read_e = 0
bits = 16
dark = 0.0
"#;
const DEVICES: &str = r#"
[devices]
camera = { driver = "gphoto2", model = "D750" }
watchdog_s = 0
[devices.axes]
driver = "grbl"
port = "{dir}/axes"
home = true
turntable = { letter = "X", backlash_deg = 2 }
settle_s = 0.0
[devices.lamps]
driver = "dmx-usb-pro"
port = "{dir}/lamps"
channel_of = [12, 11, 10, 9, 8, 7, 6, 5, 4, 3, 2, 1]
settle_s = 0.0
"#;
const LAMPS: usize = 48;
/// As the simulated camera writes them.
const QUALITY: u8 = 98;
/// Photographs of a session's field, lamp by lamp; linear, the sensor's white at 1.
fn packed(set: &Path, session: &str) -> Vec<Image> {
    let field = set.join(format!("{session}.rfield"));
    succeed(super::capture::tool("pack").arg(set.join(session)).arg("-o").arg(&field));
    let folder = set.join(format!("{session}-lamps"));
    succeed(super::capture::tool("export").args(["lp"]).arg(&field).arg("-o").arg(&folder));
    let list = fs::read_to_string(folder.join("lights.lp")).unwrap();
    let files: Vec<PathBuf> =
        list.lines().skip(1).map(|line| folder.join(line.rsplitn(4, ' ').last().unwrap())).collect();
    files.iter().map(|path| read(path, Encoding::Auto).unwrap().into_rgb()).collect()
}

/// Through the JPEG of a camera, and back.
fn through_jpeg(picture: &Image) -> Image {
    let code = |v: &f32| (srgb::encode(v.clamp(0.0, 1.0)) * 255.0).round() as u8;
    let codes: Vec<u8> = picture.data().iter().map(code).collect();
    let mut bytes = Vec::new();
    let size = (picture.width() as u32, picture.height() as u32);
    let mut encoder = JpegEncoder::new_with_quality(&mut bytes, QUALITY);
    encoder.encode(&codes, size.0, size.1, ExtendedColorType::Rgb8).unwrap();
    let codes = image::load(Cursor::new(bytes), ImageFormat::Jpeg).unwrap().into_rgb8();
    let light = |code: &u8| srgb::decode(f32::from(*code) / 255.0);
    Image::from_data(picture.width(), picture.height(), 3, codes.as_raw().iter().map(light).collect()).unwrap()
}

fn rms(a: &Image, b: &Image) -> f64 {
    let sum: f64 = a.data().iter().zip(b.data()).map(|(a, b)| f64::from(a - b).powi(2)).sum();
    (sum / a.data().len() as f64).sqrt()
}

#[test]
fn a_stage_of_real_drivers_packs_as_the_virtual_one_within_jpeg() {
    let Some(plugins) = plugin() else { return };
    let computed = Capture::with(&STAGE.replace("RESPONSE", "linear"));
    succeed(&mut computed.begin("virtual", &[]));
    let world = Simulated::start(&(STAGE.replace("RESPONSE", "srgb") + DEVICES));
    let mut capture = world.capture("real", &[]);
    let said = succeed(plug_in(&mut capture, plugins, &world.path("camera")));
    assert_eq!(photographs(&world.path("real")), photographs(&computed.path("virtual")), "{said}");

    let (real, computed) = (packed(world.folder.path(), "real"), packed(computed.folder.path(), "virtual"));
    assert_eq!((real.len(), computed.len()), (LAMPS, LAMPS));
    for (lamp, (real, computed)) in real.iter().zip(&computed).enumerate() {
        let jpeg = through_jpeg(computed);
        let (off, allowed) = (rms(real, computed), rms(&jpeg, computed));
        // What is left beside the JPEG: halves in the field (2^-11), codes that the sensor's 16 bits round to the other side.
        assert!(off <= 1.1 * allowed + 1e-4, "lamp {}: {off} from the computed one, a JPEG {allowed}", lamp + 1);
        let rest = rms(real, &jpeg);
        assert!(rest <= 0.5 * allowed + 1e-4, "lamp {}: {rest} from its JPEG", lamp + 1);
    }
    // Neighbours differ by far more: no photograph shows another condition than its own.
    for (lamp, pair) in computed.windows(2).enumerate() {
        let apart = rms(&pair[0], &pair[1]);
        let jpeg = rms(&through_jpeg(&pair[0]), &pair[0]);
        assert!(apart > 4.0 * jpeg, "lamps {} and {} look alike: {apart}, a JPEG {jpeg}", lamp + 1, lamp + 2);
    }
}
