//! How large the transfers of a stream are: what the camera needs, and what the host asks for, equal transfers all.

use crate::{
    genicam::{GenicamConfig, GenicamError, block::block_bytes},
    usb::Flight,
};

/// Bytes of a transfer, if the configuration does not say. A MiB was too much for some hosts.
const TRANSFER_BYTES: u32 = 256 << 10;
/// Transfers are multiples of this, the largest packet of a bulk endpoint.
const PACKET_BYTES: u32 = 1024;
/// The least bytes of a leader and of a trailer.
const LEAST_ENDS: [u32; 2] = [52, 36];
/// No alignment is larger: 2 to this power.
const MOST_ALIGNMENT: u32 = 20;
/// So many transfers are in flight.
const FLIGHT: std::ops::RangeInclusive<usize> = 8..=64;

/// What the camera's stream registers tell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Needs {
    /// The register with the alignment.
    pub info: u32,
    /// Bytes of a payload.
    pub payload: u64,
    /// Bytes of a leader, and of a trailer.
    pub ends: [u32; 2],
}

/// Sizes that hold a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sizes {
    /// Bytes of each transfer of the host.
    pub transfer: u32,
    /// Bytes of a block.
    pub block_bytes: usize,
    /// What the camera is told: a leader, a transfer of the payload, their count, two more transfers, a trailer.
    pub told: [u32; 6],
}

impl Sizes {
    /// Sizes for what a camera needs to send frames of so many bytes.
    ///
    /// # Errors
    /// If a camera needs what cannot be.
    pub fn new(needs: Needs, frame_bytes: usize, wanted: Option<u32>) -> Result<Self, GenicamError> {
        let block_bytes = block_bytes("the payload size of its stream", needs.payload.into(), frame_bytes)?;
        let power = needs.info >> 24;
        if power > MOST_ALIGNMENT {
            return Err(GenicamError::Usb3 { reason: format!("it aligns its transfers to 2 to the power of {power}") });
        }
        let alignment = (1 << power).max(PACKET_BYTES);
        let payload = u32::try_from(block_bytes).map_err(|_| GenicamError::Usb3 {
            reason: format!("its frames have {block_bytes} bytes, more than the protocol can count"),
        })?;
        let most = (wanted.unwrap_or(TRANSFER_BYTES) / alignment).max(1) * alignment;
        // No larger than a frame: each transfer takes that much memory of the kernel.
        let transfer = most.min(payload.next_multiple_of(alignment));
        let mut ends = [0; 2];
        for ((end, needed), least) in ends.iter_mut().zip(needs.ends).zip(LEAST_ENDS) {
            *end = needed.max(least).checked_next_multiple_of(alignment).filter(|end| *end <= transfer).ok_or_else(
                || GenicamError::Usb3 {
                    reason: format!("a leader or trailer of {needed} bytes is larger than a transfer"),
                },
            )?;
        }
        let rest = (payload % transfer).next_multiple_of(alignment);
        let [leader, trailer] = ends;
        Ok(Self { transfer, block_bytes, told: [leader, transfer, payload / transfer, rest, 0, trailer] })
    }

    /// The transfers that are wanted in flight: those of two frames.
    #[must_use]
    pub fn flight(&self, config: &GenicamConfig) -> Flight {
        let [_, _, count, rest, ..] = self.told;
        let frame = count as usize + usize::from(rest > 0) + 2;
        let transfers = config.transfers.unwrap_or((2 * frame).clamp(*FLIGHT.start(), *FLIGHT.end()));
        Flight { transfers, bytes: self.transfer as usize }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const NEEDS: Needs = Needs { info: 10 << 24, payload: 1_000_000, ends: [52, 32] };

    #[test]
    fn a_payload_is_cut_into_equal_transfers_and_a_rest_of_whole_packets() {
        let sizes = Sizes::new(NEEDS, 1_000_000, None).unwrap();
        assert_eq!(sizes.told, [1024, 262_144, 3, 214_016, 0, 1024]);
        let small = Sizes::new(Needs { payload: 3000, ..NEEDS }, 3000, None).unwrap();
        assert_eq!((small.transfer, small.told), (3072, [1024, 3072, 0, 3072, 0, 1024]));
        let whole = Sizes::new(Needs { payload: 131_072, info: 0, ..NEEDS }, 131_072, Some(65_536)).unwrap();
        assert_eq!(whole.told, [1024, 65_536, 2, 0, 0, 1024]);
        assert_eq!(small.flight(&GenicamConfig { transfers: Some(4), ..GenicamConfig::default() }).transfers, 4);
    }

    #[test]
    fn what_cannot_be_is_refused() {
        for (needs, says) in [
            (Needs { payload: u64::MAX, ..NEEDS }, "it says 18446744073709551615 bytes, and a frame has 1000000"),
            (Needs { payload: 10, ..NEEDS }, "it says 10 bytes"),
            (Needs { info: 0xff00_0000, ..NEEDS }, "power of 255"),
            (Needs { ends: [u32::MAX, 32], ..NEEDS }, "a leader or trailer of 4294967295 bytes"),
            (Needs { ends: [52, 1 << 20], ..NEEDS }, "a leader or trailer of 1048576 bytes"),
        ] {
            let error = Sizes::new(needs, 1_000_000, None).unwrap_err().to_string();
            assert!(error.contains(says), "{error}");
        }
    }

    proptest! {
        #[test]
        fn sizes_hold_a_block_or_are_refused(
            info: u32, payload: u64, near in 0_u64..3_000_000, ends: [u32; 2], frame in 1_usize..2_000_000,
            wanted in prop::option::of(1024_u32..4 << 20)
        ) {
            for payload in [payload, near] {
                for ends in [ends, [52, 36]] {
                    let Ok(sizes) = Sizes::new(Needs { info, payload, ends }, frame, wanted) else { continue };
                    let [leader, transfer, count, first, second, trailer] = sizes.told.map(u64::from);
                    prop_assert!(transfer * count + first + second >= payload);
                    prop_assert!([leader, first, second, trailer].iter().all(|size| *size <= transfer));
                    prop_assert!(sizes.told.iter().enumerate().all(|(at, size)| at == 2 || size % 1024 == 0));
                }
            }
        }
    }
}
