//! One value a pixel in memory: the layouts of grey and Bayer frames, as V4L2 and MIPI CSI-2 define them (Linux media
//! documentation, `pixfmt-yuv-luma`, `pixfmt-srggb10p`, `pixfmt-srggb12p`), and as machine-vision cameras have them (PFNC,
//! GigE Vision).

use super::Samples;

impl Samples {
    /// Significant bits of a value.
    #[must_use]
    pub fn bits(self) -> u32 {
        match self {
            Self::Bits8 => 8,
            Self::Bits10 | Self::Packed10 | Self::Lsb10 | Self::Gev10 => 10,
            Self::Bits12 | Self::Packed12 | Self::Lsb12 | Self::Gev12 => 12,
        }
    }

    /// The largest value.
    #[must_use]
    pub fn white(self) -> u16 {
        (1 << self.bits()) - 1
    }

    /// Pixels and bytes of the shortest piece that begins and ends at whole bytes.
    fn group(self) -> (usize, usize) {
        match self {
            Self::Bits8 => (1, 1),
            Self::Bits10 | Self::Bits12 => (1, 2),
            Self::Packed10 | Self::Lsb10 => (4, 5),
            Self::Packed12 | Self::Lsb12 | Self::Gev10 | Self::Gev12 => (2, 3),
        }
    }

    /// Whether rows of so many pixels can be had: packed ones are made of whole groups.
    #[must_use]
    pub fn fits(self, width: u32) -> bool {
        (width as usize).is_multiple_of(self.group().0)
    }

    /// Bytes of so many pixels that [`Samples::fits`] allows.
    #[must_use]
    pub fn bytes(self, pixels: usize) -> usize {
        let (of, bytes) = self.group();
        pixels / of * bytes
    }

    /// The value of a pixel of a frame or row; 0 beyond its end. Stray upper bits of a word make white, not a wrap.
    #[must_use]
    pub fn at(self, payload: &[u8], index: usize) -> u16 {
        let byte = |at: usize| u16::from(payload.get(at).copied().unwrap_or(0));
        let (of, bytes) = self.group();
        let (group, place) = (index / of * bytes, index % of);
        match self {
            Self::Bits8 => byte(index),
            Self::Bits10 | Self::Bits12 => (byte(group) | byte(group + 1) << 8).min(self.white()),
            Self::Packed10 => byte(group + place) << 2 | byte(group + 4) >> (2 * place) & 0b11,
            Self::Packed12 => byte(group + place) << 4 | byte(group + 2) >> (4 * place) & 0b1111,
            Self::Lsb10 | Self::Lsb12 => {
                let bit = self.bits() as usize * place;
                let two = byte(group + bit / 8) | byte(group + bit / 8 + 1) << 8;
                two >> (bit % 8) & self.white()
            }
            Self::Gev10 => byte(group + 2 * place) << 2 | byte(group + 1) >> (4 * place) & 0b11,
            Self::Gev12 => byte(group + 2 * place) << 4 | byte(group + 1) >> (4 * place) & 0b1111,
        }
    }

    /// All values of a frame in order; bytes that make no whole group at the end are left out.
    #[must_use]
    pub fn unpack(self, payload: &[u8]) -> Vec<u16> {
        let (of, bytes) = self.group();
        match self {
            Self::Bits8 => payload.iter().map(|&byte| byte.into()).collect(),
            _ => payload.chunks_exact(bytes).flat_map(|group| (0..of).map(move |at| self.at(group, at))).collect(),
        }
    }

    /// The bytes of values in this layout: what [`Samples::unpack`] reads. Values beyond white are cut to it; a group that
    /// is not full is filled with black.
    #[must_use]
    pub fn pack(self, values: &[u16]) -> Vec<u8> {
        let cut = |value: u16| value.min(self.white());
        let group = |values: &[u16]| -> Vec<u8> {
            let value = |at: usize| values.get(at).copied().map_or(0, cut);
            match self {
                Self::Bits8 => vec![value(0) as u8],
                Self::Bits10 | Self::Bits12 => value(0).to_le_bytes().to_vec(),
                Self::Packed10 | Self::Packed12 => {
                    let (of, low) = (self.group().0, self.bits() - 8);
                    let rest = (0..of).map(|at| (value(at) & ((1 << low) - 1)) << (low as usize * at)).sum::<u16>();
                    (0..of).map(|at| (value(at) >> low) as u8).chain([rest as u8]).collect()
                }
                Self::Lsb10 | Self::Lsb12 => {
                    let (of, bytes) = self.group();
                    let bits = (0..of).map(|at| u64::from(value(at)) << (self.bits() as usize * at)).sum::<u64>();
                    bits.to_le_bytes()[..bytes].to_vec()
                }
                Self::Gev10 | Self::Gev12 => {
                    let low = self.bits() - 8;
                    let rest = |at: usize| value(at) & ((1 << low) - 1);
                    vec![(value(0) >> low) as u8, (rest(0) | rest(1) << 4) as u8, (value(1) >> low) as u8]
                }
            }
        };
        values.chunks(self.group().0).flat_map(group).collect()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn the_bytes_of_the_documentation_are_these_values() {
        // pixfmt-yuv-luma, Y10: Y[7:0], then 000000 Y[9:8]; Y12: Y[7:0], then 0000 Y[11:8].
        assert_eq!(Samples::Bits10.unpack(&[0x34, 0x02, 0xff, 0x03]), [0x234, 0x3ff]);
        assert_eq!(Samples::Bits12.unpack(&[0x34, 0x0a, 0xff, 0x0f]), [0xa34, 0xfff]);
        // pixfmt-srggb10p: B00[9:2] G01[9:2] B02[9:2] G03[9:2], then G03[1:0] B02[1:0] G01[1:0] B00[1:0].
        let packed = [0b1000_0001, 0x00, 0xff, 0x12, 0b01_11_10_11];
        assert_eq!(Samples::Packed10.unpack(&packed), [0b10_0000_0111, 0b10, 0x3ff, 0x049]);
        // pixfmt-srggb12p: B00[11:4] G01[11:4], then G01[3:0] B00[3:0].
        assert_eq!(Samples::Packed12.unpack(&[0xab, 0x12, 0x5c]), [0xabc, 0x125]);
        assert_eq!(Samples::Bits8.unpack(&[0, 7, 255]), [0, 7, 255]);
        // PFNC, lsb Packed: the bits of the first value from bit 0 of byte 0 on, then those of the next.
        let packed = [0x34, 0b0101_0110, 0b0110_1100, 0b1110_0001, 0x81];
        assert_eq!(Samples::Lsb10.unpack(&packed), [0x234, 0b11_0001_0101, 0b10_0001_0110, 0b10_0000_0111]);
        assert_eq!(Samples::Lsb12.unpack(&[0xab, 0x5c, 0x12]), [0xcab, 0x125]);
        // GigE Vision: the upper bits of the first, the lower of both, the upper of the second.
        assert_eq!(Samples::Gev12.unpack(&[0xab, 0x5c, 0x12]), [0xabc, 0x125]);
        assert_eq!(Samples::Gev10.unpack(&[0x81, 0b0001_0011, 0xff]), [0b10_0000_0111, 0b11_1111_1101]);
    }

    #[test]
    fn rows_of_packed_values_are_made_of_whole_groups() {
        assert_eq!([4, 6, 7, 8].map(|width| Samples::Packed10.fits(width)), [true, false, false, true]);
        assert_eq!([2, 3].map(|width| Samples::Packed12.fits(width)), [true, false]);
        assert_eq!(Samples::ALL.map(|samples| samples.bytes(8)), [8, 16, 16, 10, 12, 10, 12, 12, 12]);
    }

    #[test]
    fn stray_upper_bits_and_missing_bytes_are_no_wrap() {
        assert_eq!(Samples::Bits10.unpack(&[0x00, 0x04]), [0x3ff]);
        assert_eq!(Samples::Bits12.at(&[0x34], 0), 0x34);
        assert_eq!(Samples::Packed10.at(&[1, 2, 3, 4, 0xff], 4), 0);
        assert_eq!(Samples::Packed12.pack(&[0xffff]), [0xff, 0, 0x0f]);
    }

    proptest! {
        #[test]
        fn what_was_packed_is_unpacked_as_it_was(
            samples in prop::sample::select(&Samples::ALL[..]),
            values in prop::collection::vec(any::<u16>(), 1..10),
        ) {
            // Whole groups of any layout.
            let values: Vec<u16> = values.iter().flat_map(|v| [*v, v >> 3, !v, v ^ 0xa5]).map(|v| v & samples.white()).collect();
            let packed = samples.pack(&values);
            prop_assert_eq!(packed.len(), samples.bytes(values.len()));
            prop_assert_eq!(&samples.unpack(&packed), &values);
            let single: Vec<u16> = (0..values.len()).map(|at| samples.at(&packed, at)).collect();
            prop_assert_eq!(single, values);
        }
    }
}
