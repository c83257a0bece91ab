//! Pixels of hosts <-> linear premultiplied RGBA in f32.
//!
//! OpenFX gives byte pixels no encoding, and hosts that hand out bytes show them as they are. So bytes are taken as
//! display-referred: colour is sRGB encoded (alpha is not), applied to the stored value, premultiplied or not as the
//! image says. Float pixels are linear.

use std::sync::LazyLock;

use relume_core::image::srgb;

use crate::host::{AlphaState, Components, Depth, Layout};

/// Linear light of each byte.
static DECODED: LazyLock<[f32; 256]> = LazyLock::new(|| std::array::from_fn(|code| srgb::decode(code as f32 / 255.0)));

/// Linear premultiplied RGBA of stored pixels. `bytes` holds `out.len() / 4` pixels in the given layout.
///
/// RGB alone has alpha one; alpha alone has no colour.
pub fn decode(layout: &Layout, bytes: &[u8], out: &mut [f32]) {
    let samples = samples(layout.components);
    let mut stored = [0.0_f32; 4];
    for (pixel, out) in bytes.chunks_exact(layout.pixel_bytes()).zip(out.chunks_exact_mut(4)) {
        for (sample, value) in stored.iter_mut().enumerate().take(samples) {
            *value = match layout.depth {
                Depth::Float => float(&pixel[sample * 4..]),
                Depth::Byte if sample == 3 || samples == 1 => f32::from(pixel[sample]) / 255.0,
                Depth::Byte => DECODED[usize::from(pixel[sample])],
            };
        }
        let rgba = match layout.components {
            Components::Rgba => stored,
            Components::Rgb => [stored[0], stored[1], stored[2], 1.0],
            Components::Alpha => [0.0, 0.0, 0.0, stored[0]],
        };
        out.copy_from_slice(&match layout.alpha {
            AlphaState::Premultiplied => rgba,
            AlphaState::Opaque => [rgba[0], rgba[1], rgba[2], 1.0],
            AlphaState::Unpremultiplied => [rgba[0] * rgba[3], rgba[1] * rgba[3], rgba[2] * rgba[3], rgba[3]],
        });
    }
}

/// Stores linear premultiplied RGBA; the reverse of [`decode`]. Bytes are rounded to nearest and clamped, NaN becomes 0.
///
/// Where the image is declared opaque, alpha is stored all the same: the host may not look at it, but a later reader
/// may.
pub fn encode(layout: &Layout, rgba: &[f32], out: &mut [u8]) {
    let samples = samples(layout.components);
    for (pixel, out) in rgba.chunks_exact(4).zip(out.chunks_exact_mut(layout.pixel_bytes())) {
        let alpha = pixel[3];
        let divisor = if layout.alpha == AlphaState::Unpremultiplied && alpha > 0.0 { alpha } else { 1.0 };
        for sample in 0..samples {
            let is_alpha = sample == 3 || samples == 1;
            let value = if is_alpha { alpha } else { pixel[sample] / divisor };
            match layout.depth {
                Depth::Float => out[sample * 4..sample * 4 + 4].copy_from_slice(&value.to_ne_bytes()),
                Depth::Byte if is_alpha => out[sample] = byte(value),
                Depth::Byte => out[sample] = byte(srgb::encode(value)),
            }
        }
    }
}

fn samples(components: Components) -> usize {
    match components {
        Components::Rgba => 4,
        Components::Rgb => 3,
        Components::Alpha => 1,
    }
}

/// Hosts align rows of floats, but nothing in the standard says so.
fn float(bytes: &[u8]) -> f32 {
    f32::from_ne_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])
}

/// `as` saturates and sends NaN to 0.
fn byte(value: f32) -> u8 {
    (value * 255.0).round() as u8
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::host::Rect;

    fn layout(depth: Depth, components: Components, alpha: AlphaState) -> Layout {
        let bounds = Rect { x1: 0, y1: 0, x2: 1, y2: 1 };
        Layout { bounds, region: bounds, region_told: true, row_bytes: 16, depth, components, alpha, aspect: 1.0 }
    }

    const PREMULTIPLIED: AlphaState = AlphaState::Premultiplied;

    #[test]
    fn every_byte_survives_the_way_through_linear() {
        let bytes: Vec<u8> = (0..=255).flat_map(|code| [code, 255 - code, code / 2, code]).collect();
        let layout = layout(Depth::Byte, Components::Rgba, PREMULTIPLIED);
        let (mut linear, mut back) = (vec![0.0; bytes.len()], vec![0; bytes.len()]);
        decode(&layout, &bytes, &mut linear);
        encode(&layout, &linear, &mut back);
        assert_eq!(bytes, back);
    }

    #[test]
    fn bytes_are_srgb_and_their_alpha_is_not() {
        let layout = layout(Depth::Byte, Components::Rgba, PREMULTIPLIED);
        let mut out = [0; 8];
        encode(&layout, &[0.215_86, 1.5, -0.25, 0.5, f32::NAN, f32::INFINITY, 1.0, 1.0], &mut out);
        assert_eq!(out, [128, 255, 0, 128, 0, 255, 255, 255]);
        let mut linear = [0.0; 4];
        decode(&layout, &[128, 255, 0, 128], &mut linear);
        assert!((linear[0] - 0.215_86).abs() < 1e-5 && (linear[3] - 128.0 / 255.0).abs() < 1e-7, "{linear:?}");
    }

    #[test]
    fn floats_pass_bit_for_bit() {
        let layout = layout(Depth::Float, Components::Rgba, PREMULTIPLIED);
        let values = [1e-38_f32, -3.0, 65_504.5, 0.1];
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_ne_bytes()).collect();
        let (mut linear, mut back) = ([0.0; 4], [0; 16]);
        decode(&layout, &bytes, &mut linear);
        encode(&layout, &linear, &mut back);
        assert_eq!((linear, &back[..]), (values, &bytes[..]));
    }

    #[test]
    fn alpha_states_and_missing_components() {
        let float = |values: &[f32]| values.iter().flat_map(|v| v.to_ne_bytes()).collect::<Vec<_>>();
        let read = |components, alpha, values: &[f32]| {
            let mut out = [9.0; 4];
            decode(&layout(Depth::Float, components, alpha), &float(values), &mut out);
            out
        };
        use AlphaState::*;
        assert_eq!(read(Components::Rgba, Unpremultiplied, &[1.0, 2.0, 4.0, 0.5]), [0.5, 1.0, 2.0, 0.5]);
        assert_eq!(read(Components::Rgba, Opaque, &[1.0, 2.0, 4.0, 0.5]), [1.0, 2.0, 4.0, 1.0]);
        assert_eq!(read(Components::Rgb, Premultiplied, &[1.0, 2.0, 4.0]), [1.0, 2.0, 4.0, 1.0]);
        assert_eq!(read(Components::Alpha, Premultiplied, &[0.25]), [0.0, 0.0, 0.0, 0.25]);
        let mut out = [0; 16];
        encode(&layout(Depth::Float, Components::Rgba, Unpremultiplied), &[0.5, 1.0, 2.0, 0.5], &mut out);
        assert_eq!(out.to_vec(), float(&[1.0, 2.0, 4.0, 0.5]));
    }
}
