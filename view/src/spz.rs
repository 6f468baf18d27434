//! Gaussians at an instant as SPZ, version 3: what Niantic's library packs into 20 bytes and one for each number of the harmonics, and most
//! viewers in browsers read. <https://github.com/nianticlabs/spz>, "File Format".
//!
//! Everything is compressed as one stream of gzip: a header, then places of all (fixed point of 24 bits), opacities, colours, logarithms of
//! scales (a byte each), rotations (the three smallest parts of the quaternion, ten bits each), harmonics (a byte each). All is in the axes
//! of OpenGL (`upright.rs`).

use std::io::Write as _;

use erfgs_scene::ply::GaussianCloud;
use flate2::{Compression, write::GzEncoder};

use crate::upright::{HARMONICS, NothingSeen, Written, opacity, place, rotation, seen};

const MAGIC: u32 = 0x5053_474e;
const VERSION: u32 = 3;
/// A colour is that share of the harmonic of degree 0, around a half.
const COLOUR: f32 = 0.15;
/// Steps of the logarithm of a scale, from this on.
const SCALE_STEPS: f32 = 16.0;
const LEAST_LOG_SCALE: f32 = -10.0;
/// Most bits behind the point of a place: 15 micrometres.
const FINEST: u32 = 16;
/// Most that 24 bits with a sign hold.
const MOST: f32 = 8_388_607.0;

/// Why there is no file.
#[derive(Debug, thiserror::Error)]
pub enum SpzError {
    /// None is left.
    #[error(transparent)]
    Nothing(#[from] NothingSeen),
    /// A place is no number, or farther away than the format can tell.
    #[error(
        "a Gaussian is at {0:?}, and SPZ has places up to 8388 km; export another format, or train with a smaller scene"
    )]
    Far([f32; 3]),
    /// Counts have 32 bits.
    #[error("{0} Gaussians are more than SPZ can count")]
    TooMany(usize),
    /// The compression failed.
    #[error("the Gaussians cannot be compressed")]
    Compression(#[from] std::io::Error),
}

/// Those Gaussians of a cloud that can be seen.
///
/// # Errors
/// [`SpzError`].
pub fn write(cloud: &GaussianCloud) -> Result<Written, SpzError> {
    let seen = seen(cloud)?;
    let count = u32::try_from(seen.len()).map_err(|_| SpzError::TooMany(seen.len()))?;
    let bits = fraction_bits(seen.iter().map(|&index| cloud.positions[index]))?;
    let mut file = GzEncoder::new(Vec::new(), Compression::best());
    file.write_all(&MAGIC.to_le_bytes())?;
    file.write_all(&VERSION.to_le_bytes())?;
    file.write_all(&count.to_le_bytes())?;
    file.write_all(&[cloud.sh_degree as u8, bits as u8, 0, 0])?;
    let mut all = |of: &dyn Fn(usize) -> Vec<u8>| -> std::io::Result<()> {
        let column: Vec<u8> = seen.iter().flat_map(|&index| of(index)).collect();
        file.write_all(&column)
    };
    let fixed = |part: f32| (part * (1_u32 << bits) as f32).round() as i32;
    all(&|index| {
        place(cloud.positions[index]).into_iter().flat_map(|part| fixed(part).to_le_bytes()[..3].to_vec()).collect()
    })?;
    all(&|index| vec![byte(255.0 * opacity(cloud, index))])?;
    let stride = cloud.sh_stride();
    let of_degree_0 = |index: usize| &cloud.sh[index * stride..][..3];
    all(&|index| of_degree_0(index).iter().map(|part| byte(255.0 * (COLOUR * part + 0.5))).collect())?;
    all(&|index| cloud.log_scales[index].map(|log| byte(SCALE_STEPS * (log - LEAST_LOG_SCALE))).to_vec())?;
    all(&|index| smallest_three(rotation(cloud.rotations[index])).to_le_bytes().to_vec())?;
    let signs: Vec<f32> = HARMONICS[..=cloud.sh_degree as usize].concat();
    all(&|index| {
        let harmonics = cloud.sh[index * stride..][..3 * signs.len()].as_chunks::<3>().0;
        let turned = std::iter::zip(harmonics, &signs).skip(1).flat_map(|(rgb, sign)| rgb.map(|part| part * sign));
        turned.map(|part| byte(128.0 * part + 128.0)).collect()
    })?;
    Ok(Written { bytes: file.finish()?, gaussians: seen.len() })
}

fn byte(value: f32) -> u8 {
    value.round().clamp(0.0, 255.0) as u8
}

/// As many bits behind the point as all places leave room for.
fn fraction_bits(places: impl Iterator<Item = [f32; 3]>) -> Result<u32, SpzError> {
    let mut bits = FINEST;
    for place in places {
        for part in place {
            while part.is_nan() || part.abs() * (1_u32 << bits) as f32 > MOST {
                bits = bits.checked_sub(1).ok_or(SpzError::Far(place))?;
            }
        }
    }
    Ok(bits)
}

/// A rotation (x, y, z, w of length 1) without its largest part, which is positive: which that is (two bits), then of each other one a sign and its
/// size as a part of the largest that it can have.
fn smallest_three(xyzw: [f32; 4]) -> u32 {
    let largest = (1..4).fold(0, |best, at| if xyzw[at].abs() > xyzw[best].abs() { at } else { best });
    let turned = xyzw[largest] < 0.0;
    let others = (0..4).filter(|&at| at != largest);
    others.fold(largest as u32, |word, at| {
        let part = xyzw[at];
        let size = (511.0 * part.abs() * std::f32::consts::SQRT_2).round().min(511.0) as u32;
        word << 10 | u32::from((part < 0.0) != turned) << 9 | size
    })
}

#[cfg(test)]
mod tests {
    use std::io::Read as _;

    use super::*;
    use crate::upright::tests::harmonics;

    /// What a file holds, as its description has it.
    struct Unpacked {
        places: Vec<[f32; 3]>,
        opacities: Vec<f32>,
        log_scales: Vec<[f32; 3]>,
        /// x, y, z, w.
        rotations: Vec<[f32; 4]>,
        /// Of one Gaussian after the other, red, green and blue of one harmonic after the other.
        sh: Vec<f32>,
    }

    fn unpacked(bytes: &[u8]) -> Unpacked {
        let mut all = Vec::new();
        flate2::read::GzDecoder::new(bytes).read_to_end(&mut all).unwrap();
        let word = |at: usize| u32::from_le_bytes(all[at..at + 4].try_into().unwrap());
        assert_eq!([word(0), word(4)], [u32::from_le_bytes(*b"NGSP"), 3]);
        let (count, degree, bits) = (word(8) as usize, usize::from(all[12]), all[13]);
        let rest = (degree + 1) * (degree + 1) - 1;
        assert_eq!(all.len(), 16 + count * (20 + 3 * rest));
        let mut at = 16;
        let mut column = |width: usize| {
            at += count * width;
            all[at - count * width..at].to_vec()
        };
        let fixed = |three: &[u8]| i32::from_le_bytes([0, three[0], three[1], three[2]]) as f32 / 256.0;
        let places: Vec<f32> = column(9).chunks(3).map(|three| fixed(three) / (1_u32 << bits) as f32).collect();
        let opacities = column(1).into_iter().map(|byte| f32::from(byte) / 255.0).collect();
        let colours: Vec<f32> = column(3).into_iter().map(|byte| (f32::from(byte) / 255.0 - 0.5) / 0.15).collect();
        let log_scales: Vec<f32> = column(3).into_iter().map(|byte| f32::from(byte) / 16.0 - 10.0).collect();
        let rotation = |word: u32| {
            let largest = (word >> 30) as usize;
            let mut parts = [0.0; 4];
            for (place, at) in (0..4).filter(|&at| at != largest).rev().enumerate() {
                let code = word >> (10 * place) & 0x3ff;
                let size = (code & 511) as f32 / 511.0 * std::f32::consts::FRAC_1_SQRT_2;
                parts[at] = if code & 512 == 0 { size } else { -size };
            }
            parts[largest] = (1.0 - parts.iter().map(|part| part * part).sum::<f32>()).max(0.0).sqrt();
            parts
        };
        let rotations = column(4).as_chunks::<4>().0.iter().map(|four| rotation(u32::from_le_bytes(*four))).collect();
        let others: Vec<f32> = column(3 * rest).into_iter().map(|byte| (f32::from(byte) - 128.0) / 128.0).collect();
        let both =
            (0..count).flat_map(|row| [&colours[3 * row..][..3], &others[3 * rest * row..][..3 * rest]].concat());
        Unpacked {
            sh: both.collect(),
            places: places.as_chunks().0.to_vec(),
            log_scales: log_scales.as_chunks().0.to_vec(),
            opacities,
            rotations,
        }
    }

    fn cloud() -> GaussianCloud {
        let wave = |k: usize| (0.37 * k as f32).sin();
        GaussianCloud {
            sh_degree: 3,
            positions: vec![[1.0, 2.0, 3.0], [4.0, -5.0, 60.0], [-0.001, 0.002, -0.5]],
            log_scales: vec![[0.0; 3], [-3.0, -4.0, -5.0], [-9.0, 1.0, 2.0]],
            rotations: vec![[1.0, 0.0, 0.0, 0.0], [0.2, -1.4, 0.6, 0.9], [0.0; 4]],
            opacity_logits: vec![-40.0, 0.0, 3.0],
            sh: (0..48 * 3).map(|k| 0.9 * wave(k)).collect(),
        }
    }

    #[test]
    fn what_can_be_seen_is_packed_to_the_steps_of_the_format() {
        let cloud = cloud();
        let Written { bytes, gaussians } = write(&cloud).unwrap();
        let found = unpacked(&bytes);
        assert_eq!((gaussians, found.opacities.len()), (2, 2));
        for (row, index) in [1, 2].into_iter().enumerate() {
            let near = |a: &[f32], b: &[f32], step: f32| {
                let off = std::iter::zip(a, b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
                assert!(off <= 0.501 * step, "{a:?} {b:?}");
            };
            near(&found.places[row], &place(cloud.positions[index]), 1.0 / 65_536.0);
            near(&[found.opacities[row]], &[opacity(&cloud, index)], 1.0 / 255.0);
            near(&found.log_scales[row], &cloud.log_scales[index], 1.0 / 16.0);
            let [own, there] = [rotation(cloud.rotations[index]), found.rotations[row]];
            let cos: f32 = std::iter::zip(own, there).map(|(a, b)| a * b).sum();
            assert!(cos.abs() > 0.999_99, "{own:?} {there:?}");
            // A colour seen along a way is that of the turned harmonics along the turned way.
            for way in [[0.6, -0.64, 0.48], [-0.36, 0.48, 0.8], [0.0, 0.0, 1.0]] {
                let (own, there) = (&cloud.sh[48 * index..][..48], &found.sh[48 * row..][..48]);
                let seen = |sh: &[f32], way| -> Vec<f32> {
                    let basis = harmonics(way);
                    (0..3).map(|channel| (0..16).map(|k| basis[k] * sh[3 * k + channel]).sum()).collect()
                };
                near(&seen(own, way), &seen(there, place(way)), 1.0 / 20.0);
            }
        }
    }

    #[test]
    fn places_have_the_bits_that_they_leave_room_for() {
        let bits = |place: [f32; 3]| fraction_bits([place].into_iter()).ok();
        assert_eq!([bits([0.0; 3]), bits([127.9, 0.0, 0.0]), bits([0.0, 128.1, 0.0])], [Some(16), Some(16), Some(15)]);
        assert_eq!([bits([0.0, 0.0, -8e6]), bits([9e6, 0.0, 0.0]), bits([f32::NAN; 3])], [Some(0), None, None]);
        let far = GaussianCloud { positions: vec![[f32::INFINITY; 3]; 3], ..cloud() };
        assert!(matches!(write(&far), Err(SpzError::Far(_))));
        let nothing = GaussianCloud { opacity_logits: vec![-40.0; 3], ..cloud() };
        assert!(matches!(write(&nothing), Err(SpzError::Nothing(_))));
    }

    #[test]
    fn rotations_are_kept_whichever_part_is_the_largest() {
        for largest in 0..4 {
            for sign in [-1.0, 1.0_f32] {
                let mut parts = [0.3, -0.2, 0.1, 0.25];
                parts[largest] = 0.9 * sign;
                let length = parts.iter().map(|part| part * part).sum::<f32>().sqrt();
                let word = smallest_three(parts.map(|part| part / length));
                assert_eq!(word >> 30, largest as u32);
                let first = (0..4).find(|&at| at != largest).unwrap();
                let is_negative = (parts[first] < 0.0) != (sign < 0.0);
                assert_eq!(word >> 29 & 1 == 1, is_negative, "{parts:?}");
            }
        }
        assert_eq!(smallest_three([0.5; 4]) & 0x1ff, 361);
    }
}
