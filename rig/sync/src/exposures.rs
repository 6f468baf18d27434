//! When the frames of a stream were exposed: the middle and the length of each.

use std::collections::HashMap;

use erfgs_session::clock::{Exposure, Residuals};
use serde::{Deserialize, Serialize};

/// The frames of a stream in session time. Columns are parallel: one entry for each frame.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(into = "ExposuresFile", try_from = "ExposuresFile")]
pub struct Exposures {
    /// Sequence numbers of the packets.
    pub sequence: Vec<u64>,
    /// The pulse of the board that triggered each frame; empty where that is not how frames are dated.
    pub pulse: Vec<u64>,
    /// The middle of each exposure, nanoseconds of session time.
    pub mid_ns: Vec<i64>,
    /// How long each frame was exposed, nanoseconds: as the camera was set, or while its own trigger or its strobe was high; empty
    /// where nothing tells.
    pub exposure_ns: Vec<i64>,
    /// How long after the middle of the exposure a frame is stamped, nanoseconds: the median that was found (triggered; where
    /// exposures differ, of a frame of the usual length), or what was assumed or found by a flash and has been taken off.
    pub lag_ns: i64,
    /// Distances of the stamps from that lag. Of a free-running camera whose frames do not come at even intervals, how much
    /// neighbouring stamps jitter.
    pub residuals: Residuals,
    /// Frames of a free-running camera whose stamps were fitted with a period; the others have their stamps as they are.
    pub fitted: u64,
    /// Pulses or strobes between the first and the last matched one that gave no frame.
    pub missed_pulses: u64,
    /// Frames that belong to no pulse or strobe.
    pub unmatched: u64,
}

impl Exposures {
    /// The exposure of each frame, by the sequence number of its packet.
    #[must_use]
    pub fn by_sequence(&self) -> HashMap<u64, Exposure> {
        let frames = std::iter::zip(&self.sequence, &self.mid_ns).enumerate();
        frames
            .map(|(at, (&sequence, &mid_ns))| {
                (sequence, Exposure { mid_ns, length_ns: self.exposure_ns.get(at).copied() })
            })
            .collect()
    }

    /// How far a stamp of each frame lies from where the lag puts it, nanoseconds. A frame is stamped after its exposure, so
    /// that one that was exposed for longer is stamped later after its middle, by half of what it is longer.
    pub(super) fn off_ns(&self, at: usize, usual_ns: i64, stamp_ns: i64) -> Option<i64> {
        let longer = self.exposure_ns.get(at).map_or(0, |length| length / 2 - usual_ns / 2);
        let mid_ns = self.mid_ns.get(at)?;
        Some(stamp_ns.saturating_sub(*mid_ns).saturating_sub(self.lag_ns).saturating_sub(longer))
    }

    /// The usual length of an exposure, nanoseconds: the median; 0 where nothing tells.
    pub(super) fn usual_ns(&self) -> i64 {
        median(self.exposure_ns.clone()).unwrap_or(0)
    }
}

/// The middle one of some numbers, the upper of two; `None` of none.
pub(super) fn median(mut numbers: Vec<i64>) -> Option<i64> {
    let middle = numbers.len() / 2;
    (!numbers.is_empty()).then(|| *numbers.select_nth_unstable(middle).1)
}

/// As files have it: one length for all frames, or a column of them where they differ.
#[derive(Clone, Serialize, Deserialize)]
struct ExposuresFile {
    sequence: Vec<u64>,
    pulse: Vec<u64>,
    mid_ns: Vec<i64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    exposure_ns: Option<i64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    each_exposure_ns: Option<Vec<i64>>,
    lag_ns: i64,
    residuals: Residuals,
    #[serde(default)]
    fitted: u64,
    missed_pulses: u64,
    unmatched: u64,
}

impl From<Exposures> for ExposuresFile {
    fn from(exposures: Exposures) -> Self {
        let Exposures { sequence, pulse, mid_ns, exposure_ns, lag_ns, residuals, fitted, missed_pulses, unmatched } =
            exposures;
        let first = exposure_ns.first().copied();
        let alike = exposure_ns.iter().all(|&length| Some(length) == first);
        let (exposure_ns, each_exposure_ns) = if alike { (first, None) } else { (None, Some(exposure_ns)) };
        Self {
            sequence,
            pulse,
            mid_ns,
            exposure_ns,
            each_exposure_ns,
            lag_ns,
            residuals,
            fitted,
            missed_pulses,
            unmatched,
        }
    }
}

impl TryFrom<ExposuresFile> for Exposures {
    type Error = String;

    fn try_from(file: ExposuresFile) -> Result<Self, String> {
        let frames = file.sequence.len();
        let exposure_ns = match (file.each_exposure_ns, file.exposure_ns) {
            (Some(each), _) => each,
            (None, Some(length)) => vec![length; frames],
            (None, None) => Vec::new(),
        };
        let column = |name: &str, length: usize, may_be_absent: bool| {
            if length == frames || (may_be_absent && length == 0) {
                return Ok(());
            }
            Err(format!("`exposures` has {frames} frames, but {length} entries in `{name}`"))
        };
        column("mid_ns", file.mid_ns.len(), false)?;
        column("pulse", file.pulse.len(), true)?;
        column("each_exposure_ns", exposure_ns.len(), true)?;
        let ExposuresFile { sequence, pulse, mid_ns, lag_ns, residuals, fitted, missed_pulses, unmatched, .. } = file;
        Ok(Self { sequence, pulse, mid_ns, exposure_ns, lag_ns, residuals, fitted, missed_pulses, unmatched })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn exposures(exposure_ns: Vec<i64>) -> Exposures {
        let (sequence, mid_ns) = (vec![4, 5, 7], vec![10, 20, 40]);
        Exposures { sequence, mid_ns, exposure_ns, ..Exposures::default() }
    }

    #[test]
    fn files_have_one_length_or_one_for_each_frame() {
        for (lengths, inside) in [
            (vec![], None),
            (vec![6, 6, 6], Some(r#""exposure_ns":6,"#)),
            (vec![2, 6, 2], Some(r#""each_exposure_ns":[2,6,2],"#)),
        ] {
            let exposures = exposures(lengths);
            let text = serde_json::to_string(&exposures).unwrap();
            assert_eq!(text.contains("exposure_ns"), inside.is_some(), "{text}");
            assert!(inside.is_none_or(|inside| text.contains(inside)), "{text}");
            assert_eq!(serde_json::from_str::<Exposures>(&text).unwrap(), exposures);
        }
    }

    #[test]
    fn columns_of_different_lengths_are_refused() {
        let text = serde_json::to_string(&exposures(vec![2, 6, 2])).unwrap();
        for (part, short) in [("[2,6,2]", "[2,6]"), ("[10,20,40]", "[10]"), (r#""pulse":[]"#, r#""pulse":[1]"#)] {
            let error = serde_json::from_str::<Exposures>(&text.replace(part, short)).unwrap_err().to_string();
            assert!(error.contains("has 3 frames"), "{error}");
        }
    }
}
