//! Codes as a display server wants them: bytes of pixels, in its order, its rows padded as it says.

use super::{Layout, Texels};

/// How a server stores the pixels of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PixelFormat {
    /// Which bits of a pixel are red, green and blue.
    pub masks: [u32; 3],
    /// 16, 24 or 32.
    pub bits_per_pixel: u8,
    /// Rows are padded to a multiple of so many bits.
    pub row_bits: u8,
    /// The most significant byte of a pixel comes first.
    pub big_endian: bool,
}

impl PixelFormat {
    /// 8 bits a channel in words of 32 as the machine has them: red in the middle, blue lowest (what softbuffer takes).
    pub const XRGB: Self = Self {
        masks: [0xff_0000, 0xff00, 0xff],
        bits_per_pixel: 32,
        row_bits: 32,
        big_endian: cfg!(target_endian = "big"),
    };

    /// Bits of the channel that has fewest.
    pub fn depth(&self) -> u32 {
        self.masks.iter().map(|mask| mask.count_ones()).min().unwrap_or(0)
    }

    /// A pixel of codes whose white is `white`: the bits themselves where the server has as many, else spread over its range.
    pub fn pixel(&self, codes: [u16; 3], white: u16) -> u32 {
        let channel = |mask: u32, code: u16| {
            let (shift, largest) = (mask.trailing_zeros(), u64::from(mask.count_ones()));
            let largest = (1u64 << largest) - 1;
            let (code, white) = (u64::from(code.min(white)), u64::from(white.max(1)));
            (((code * largest + white / 2) / white) as u32).checked_shl(shift).unwrap_or(0)
        };
        (0..3).map(|c| channel(self.masks[c], codes[c])).fold(0, |pixel, bits| pixel | bits)
    }

    /// Bytes of a row.
    pub fn row_bytes(&self, width: usize) -> usize {
        let unit = usize::from(self.row_bits.max(8));
        (width * usize::from(self.bits_per_pixel)).div_ceil(unit) * unit / 8
    }

    /// Texels as the whole output's bytes.
    pub fn pack(&self, texels: &Texels, layout: &Layout) -> Vec<u8> {
        let (width, height) = layout.output;
        let (row_bytes, step) = (self.row_bytes(width), usize::from(self.bits_per_pixel) / 8);
        // Black is no bit at all.
        let mut bytes = vec![0; row_bytes * height];
        let word = self.bytes_of();
        for (row, codes) in texels.codes.chunks_exact(texels.columns.max(1)).enumerate() {
            let first = (layout.corner.1 + row * layout.texel_px) * row_bytes;
            let mut at = first + layout.corner.0 * step;
            for codes in codes {
                let pixel = word(self.pixel(*codes, texels.white));
                for _ in 0..layout.texel_px {
                    bytes[at..at + step].copy_from_slice(&pixel[..step]);
                    at += step;
                }
            }
            for copy in 1..layout.texel_px {
                bytes.copy_within(first..first + row_bytes, first + copy * row_bytes);
            }
        }
        bytes
    }

    /// A pixel's bytes, those that count first.
    fn bytes_of(&self) -> impl Fn(u32) -> [u8; 4] + use<> {
        let (big_endian, unused) = (self.big_endian, 32 - u32::from(self.bits_per_pixel.min(32)));
        move |pixel| if big_endian { (pixel << unused).to_be_bytes() } else { pixel.to_le_bytes() }
    }

    /// Back from bytes to each pixel's channels, as large as the masks have them.
    #[cfg(test)]
    pub fn unpack(&self, bytes: &[u8], (width, height): (usize, usize)) -> Vec<[u16; 3]> {
        let (row_bytes, step) = (self.row_bytes(width), usize::from(self.bits_per_pixel) / 8);
        let channels = |bytes: &[u8]| {
            let shift = |n: usize| 8 * if self.big_endian { step - 1 - n } else { n };
            let pixel = bytes.iter().enumerate().fold(0u32, |pixel, (n, byte)| pixel | u32::from(*byte) << shift(n));
            self.masks.map(|mask| ((pixel & mask) >> mask.trailing_zeros()) as u16)
        };
        let row = |y: usize| bytes[y * row_bytes..][..width * step].chunks_exact(step).map(channels);
        (0..height).flat_map(row).collect()
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg32;

    use super::*;

    const DEEP: PixelFormat =
        PixelFormat { masks: [0x3ff0_0000, 0xf_fc00, 0x3ff], bits_per_pixel: 32, row_bits: 32, big_endian: false };

    #[test]
    fn words_of_the_servers_that_there_are() {
        let little = PixelFormat { big_endian: false, ..PixelFormat::XRGB };
        let one = Texels { columns: 1, rows: 1, white: 255, codes: vec![[1, 2, 3]] };
        let pixel =
            |format: PixelFormat, texels: &Texels| format.pack(texels, &Layout::new("", (1, 1), (1, 1), None).unwrap());
        assert_eq!(pixel(little, &one), [3, 2, 1, 0]);
        assert_eq!(pixel(PixelFormat { big_endian: true, ..little }, &one), [0, 1, 2, 3]);
        let packed = PixelFormat { bits_per_pixel: 24, ..little };
        assert_eq!(pixel(packed, &one), [3, 2, 1, 0], "three bytes, and one that pads the row");
        assert_eq!(pixel(PixelFormat { big_endian: true, ..packed }, &one), [1, 2, 3, 0]);
        let deep = Texels { white: 1023, codes: vec![[1023, 1, 512]], ..one.clone() };
        assert_eq!(pixel(DEEP, &deep), 0x3ff0_0600u32.to_le_bytes());
        // Eight bits on a deeper server: white is white.
        assert_eq!(DEEP.pixel([255, 0, 128], 255), 1023 << 20 | 514);
    }

    #[test]
    fn pixels_come_back_as_the_layout_says() {
        let mut random = Pcg32::seed_from_u64(7);
        let thin = PixelFormat { bits_per_pixel: 24, row_bits: 32, ..PixelFormat::XRGB };
        let formats = [PixelFormat::XRGB, DEEP, thin, PixelFormat { big_endian: true, ..thin }];
        for n in 0..80 {
            let format = formats[n % formats.len()];
            let white = if format == DEEP { 1023 } else { 255 };
            let size = (random.random_range(1..9), random.random_range(1..9));
            let output = (size.0 * 2 + random.random_range(0..7), size.1 * 2 + random.random_range(0..7));
            let layout = Layout::new("", size, output, None).unwrap();
            let codes = (0..size.0 * size.1).map(|_| [(); 3].map(|()| random.random_range(0..=white))).collect();
            let texels = Texels { columns: size.0, rows: size.1, white, codes };
            let bytes = format.pack(&texels, &layout);
            assert_eq!(bytes.len(), format.row_bytes(output.0) * output.1);
            for (at, found) in format.unpack(&bytes, output).into_iter().enumerate() {
                let texel = layout.texel(at % output.0, at / output.0);
                assert_eq!(found, texel.map_or([0; 3], |(x, y)| texels.codes[y * size.0 + x]), "{layout:?}");
            }
        }
    }
}
