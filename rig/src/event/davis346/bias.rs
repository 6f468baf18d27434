//! Biases of the DAVIS346 chip: currents, which an on-chip generator makes as a coarse current divided finely.
//!
//! Sources: libcaer `src/davis.c` (`caerBiasCoarseFineFromCurrent`, coarse currents), `src/davis_common.h` (defaults,
//! kinds); the generator: Delbrück et al., "32-bit configurable bias current generator", ISCAS 2010.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

use super::spi::{Parameter, Spi};
use crate::event::EventError;

/// The largest current of each coarse range, picoampere.
const COARSE_PA: [u32; 8] = [11, 94, 756, 6054, 48_437, 387_500, 3_100_000, 24_800_000];

/// The largest current of a bias, picoampere.
pub(super) const MOST_PA: u32 = 24_800_000;

/// A coarse range and a division of it: `COARSE_PA[coarse] · fine / 255`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CoarseFine {
    /// Range, 0 to 7.
    pub coarse: u8,
    /// Division, 0 to 255.
    pub fine: u8,
}

impl CoarseFine {
    /// The setting nearest to a current; of equally near ones the finest range. Ranges overlap, so that all are tried.
    #[must_use]
    pub fn of_current(picoampere: u32) -> Self {
        let mut best = Self { coarse: 0, fine: 0 };
        for coarse in 0..8_u8 {
            let range = f64::from(COARSE_PA[usize::from(coarse)]);
            let fine = (255.0 * f64::from(picoampere) / range).round().clamp(0.0, 255.0) as u8;
            let candidate = Self { coarse, fine };
            // A fine value of 0 switches the bias off, which only no current asks for.
            let allowed = fine > 0 || picoampere == 0;
            let error = |setting: Self| (setting.current() - f64::from(picoampere)).abs();
            if allowed && (best.fine == 0 && picoampere > 0 || error(candidate) < error(best)) {
                best = candidate;
            }
        }
        best
    }

    /// The current that it makes, picoampere.
    #[must_use]
    pub fn current(self) -> f64 {
        f64::from(COARSE_PA[usize::from(self.coarse & 7)]) * f64::from(self.fine) / 255.0
    }

    /// The word for the chip. `kind` are its low four bits: enabled, N type, normal (not cascode), normal (not low)
    /// current.
    fn word(self, kind: u32) -> u32 {
        kind | u32::from(self.fine) << 4 | u32::from(self.coarse) << 12
    }
}

const N: u32 = 0b1111;
const N_OFF: u32 = 0b1110;
const P: u32 = 0b1101;

/// A bias of the chip.
struct Bias {
    name: &'static str,
    parameter: Parameter,
    kind: u32,
    default: CoarseFine,
}

macro_rules! biases {
    ($($(#[$meta:meta])* $field:ident: $parameter:literal, $kind:ident, $coarse:literal, $fine:literal;)*) => {
        /// Currents of the chip's biases, picoampere: 0 to 24,800,000, `None`: the maker's default. The currents that
        /// can be made are 2041 steps; the nearest is taken and told in the settings.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
        #[serde(deny_unknown_fields, default)]
        pub struct BiasCurrents {
            $($(#[$meta])* pub $field: Option<u32>,)*
        }

        const BIASES: &[Bias] = &[$(Bias {
            name: stringify!($field),
            parameter: Parameter(5, $parameter),
            kind: $kind,
            default: CoarseFine { coarse: $coarse, fine: $fine },
        },)*];

        impl BiasCurrents {
            fn values(&self) -> Vec<Option<u32>> {
                vec![$(self.$field,)*]
            }
        }
    };
}

biases! {
    /// Local buffers of the array (LocalBufBn).
    local_buffer: 8, N, 5, 164;
    /// Follower of the pads (PadFollBn), off.
    pad_follower: 9, N_OFF, 7, 215;
    /// Reference of both contrast thresholds (DiffBn).
    diff: 10, N, 4, 39;
    /// Contrast threshold of rising intensity (OnBn): a higher current is less sensitive.
    on: 11, N, 5, 255;
    /// Contrast threshold of falling intensity (OffBn): a lower current is less sensitive.
    off: 12, N, 4, 1;
    /// Inverters of the pixels (PixInvBn).
    pixel_inverter: 13, N, 6, 144;
    /// Photoreceptor (PrBp): a higher current is faster and noisier.
    photoreceptor: 14, P, 2, 58;
    /// Follower of the photoreceptor (PrSFBp): its low-pass filter.
    photoreceptor_follower: 15, P, 1, 16;
    /// Refractory period (RefrBp): a higher current is shorter.
    refractory: 16, P, 4, 25;
    /// Buffers of the frames' read-out (ReadoutBufBp).
    readout_buffer: 17, P, 6, 20;
    /// Followers of the frames' columns (ApsROSFBn).
    aps_follower: 18, N, 6, 219;
    /// Comparators of the ADC (AdcCompBp).
    adc_comparator: 19, P, 5, 20;
    /// Selection of columns (ColSelLowBn).
    column_select: 20, N, 0, 1;
    /// Buffers of the ADC's reference (DACBufBp).
    dac_buffer: 21, P, 6, 60;
    /// Time-out of columns (LcolTimeoutBn).
    column_timeout: 22, N, 5, 49;
    /// Address encoder, pull-down (AEPdBn).
    address_pull_down: 23, N, 6, 91;
    /// Address encoder, pull-up of columns (AEPuXBp).
    address_pull_up_x: 24, P, 4, 80;
    /// Address encoder, pull-up of rows (AEPuYBp).
    address_pull_up_y: 25, P, 7, 152;
    /// Test neuron, refractory period (IFRefrBn).
    neuron_refractory: 26, N, 5, 255;
    /// Test neuron, threshold (IFThrBn).
    neuron_threshold: 27, N, 5, 255;
    /// Buffers of the biases (BiasBuffer).
    bias_buffer: 34, N, 5, 254;
}

impl BiasCurrents {
    /// Checks the ranges.
    pub(super) fn validate(&self) -> Result<(), EventError> {
        for (bias, value) in BIASES.iter().zip(self.values()) {
            EventError::check(&format!("biases.{}", bias.name), value.unwrap_or(0), 0..=MOST_PA)?;
        }
        Ok(())
    }
}

/// Voltages that are not for users: APS overflow level, cascode, ADC references and test voltage, as voltage (bits 0 to
/// 5) and current (bits 6 to 8); then the two shifted sources, as reference (bits 4 to 9) and regulator (bits 10 to 15).
const FIXED: [(Parameter, u32); 7] = [
    (Parameter(5, 0), 27 | 6 << 6),
    (Parameter(5, 1), 21 | 6 << 6),
    (Parameter(5, 2), 32 | 7 << 6),
    (Parameter(5, 3), 1 | 7 << 6),
    (Parameter(5, 4), 21 | 7 << 6),
    (Parameter(5, 35), 1 << 4 | 33 << 10),
    (Parameter(5, 36), 1 << 4 | 33 << 10),
];

/// Writes all biases and tells which currents the chip makes now.
pub(super) fn write(spi: &Spi, currents: &BiasCurrents) -> Result<Value, EventError> {
    spi.write_each(&FIXED)?;
    let mut settings = Map::new();
    for (bias, wanted) in BIASES.iter().zip(currents.values()) {
        let setting = wanted.map_or(bias.default, CoarseFine::of_current);
        spi.write(bias.parameter, setting.word(bias.kind))?;
        settings.insert(
            bias.name.into(),
            json!({
                "wanted_pa": wanted,
                "current_pa": (setting.current() * 1000.0).round() / 1000.0,
                "coarse": setting.coarse,
                "fine": setting.fine,
            }),
        );
    }
    Ok(settings.into())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn words_are_those_of_the_maker() {
        let word = |name: &str| BIASES.iter().find(|bias| bias.name == name).map(|b| b.default.word(b.kind)).unwrap();
        assert_eq!(BIASES.len(), 21);
        assert_eq!(word("local_buffer"), 15 | 164 << 4 | 5 << 12);
        assert_eq!(word("pad_follower"), 14 | 215 << 4 | 7 << 12);
        assert_eq!(word("photoreceptor"), 13 | 58 << 4 | 2 << 12);
    }

    #[test]
    fn no_current_switches_off_and_the_largest_is_reached() {
        assert_eq!(CoarseFine::of_current(0), CoarseFine { coarse: 0, fine: 0 });
        assert_eq!(CoarseFine::of_current(24_800_000), CoarseFine { coarse: 7, fine: 255 });
        assert_eq!(CoarseFine::of_current(1), CoarseFine { coarse: 0, fine: 23 });
    }

    proptest! {
        #[test]
        fn the_nearest_of_all_settings_is_found(picoampere in 1_u32..=24_800_000) {
            let found = CoarseFine::of_current(picoampere);
            let error = (found.current() - f64::from(picoampere)).abs();
            for coarse in 0..8 {
                for fine in 1..=255 {
                    let other = (CoarseFine { coarse, fine }.current() - f64::from(picoampere)).abs();
                    prop_assert!(error <= other + 1e-6, "{:?} beats {:?}", (coarse, fine), found);
                }
            }
            // Steps are never coarser than 1/25 of the current, but for the very smallest currents.
            prop_assert!(error <= 0.05 || error / f64::from(picoampere) < 0.02);
        }

        #[test]
        fn a_setting_is_found_again_from_its_current(coarse in 0_u8..8, fine in 1_u8..=255) {
            let current = CoarseFine { coarse, fine }.current();
            let again = CoarseFine::of_current(current.round() as u32);
            prop_assert!((again.current() - current).abs() <= 0.5 + current * 0.02);
        }
    }
}
