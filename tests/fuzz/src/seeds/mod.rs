//! What the targets start from: small streams and files, made of the words of the tests and by the encoders. `plan.rs` says
//! what comes before a stream.

mod arrays;
mod chunks;
mod frames;
mod inivation;
#[cfg(target_os = "linux")]
mod machine_vision;
mod prophesee;
mod session_files;

use std::{collections::BTreeMap, sync::LazyLock};

use erfgs_events::{CdEvent, SensorSize};

#[allow(dead_code, reason = "the tests of sessions use the rest")]
#[path = "../../../../session/tests/it/common.rs"]
mod sessions;
#[path = "../../../../events/tests/it/words.rs"]
mod words;

const SIZE: SensorSize = SensorSize { width: 6, height: 4 };
/// What is before a stream: no cuts; pieces of 7 bytes; two cuts, with a restart and with a hint.
const PLANS: [&[u8]; 3] = [&[0, 0], &[0, 1, 7], &[0, 0x22, 3, 64, 40, 0, 3, 1, 0, 0, 24, 0, 2 | 20 << 2, 9, 0, 0]];

/// The seeds of a target; none of an unknown one.
#[must_use]
pub fn seeds(target: &str) -> &'static [Vec<u8>] {
    static SEEDS: LazyLock<Seeds> = LazyLock::new(Seeds::all);
    SEEDS.0.get(target).map_or(&[], |seeds| seeds)
}

/// Collects seeds by target.
#[derive(Default)]
struct Seeds(BTreeMap<&'static str, Vec<Vec<u8>>>);

impl Seeds {
    fn all() -> Self {
        let mut seeds = Self::default();
        let evt3 = prophesee::put(&mut seeds);
        let davis = inivation::put(&mut seeds);
        arrays::put(&mut seeds);
        chunks::put(&mut seeds);
        frames::put(&mut seeds);
        #[cfg(target_os = "linux")]
        machine_vision::put(&mut seeds);
        session_files::put(&mut seeds, &evt3, &davis);
        seeds
    }

    fn put(&mut self, target: &'static str, bytes: &[u8]) {
        self.0.entry(target).or_default().push(bytes.to_vec());
    }

    /// A stream with these options, taken apart in several ways.
    fn stream(&mut self, target: &'static str, options: u8, stream: &[u8]) {
        for plan in PLANS {
            self.put(target, &[&[options], &plan[1..], stream].concat());
        }
    }
}

fn events() -> Vec<CdEvent> {
    let event =
        |n: u64| CdEvent { t_us: 4_000 + n * n * 7, x: (n % 6) as u16, y: (n / 6 % 4) as u16, on: n.is_multiple_of(3) };
    (0..40).map(event).collect()
}
