//! The sRGB transfer curve (IEC 61966-2-1:1999), continued by odd symmetry below zero and by its power above one.

/// Code value (0..1) to linear light.
pub fn decode(code: f32) -> f32 {
    let c = code.abs();
    let linear = if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) };
    linear.copysign(code)
}

/// Linear light to code value.
pub fn encode(linear: f32) -> f32 {
    let l = linear.abs();
    let code = if l <= 0.003_130_8 { 12.92 * l } else { 1.055 * l.powf(1.0 / 2.4) - 0.055 };
    code.copysign(linear)
}

#[cfg(test)]
mod tests {
    use super::{decode, encode};

    #[test]
    fn every_8_bit_code_survives_the_round_trip() {
        for code in 0..=255u8 {
            let light = decode(f32::from(code) / 255.0);
            assert_eq!((encode(light) * 255.0).round() as u8, code);
        }
    }
}
