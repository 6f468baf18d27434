//! The clock of a stream whose time words hold only the middle bits of the time: it rolls over, and words get lost.
//!
//! A time word `new` follows `old` by `d = (new - old) mod loop`. Sensors send time words without a break, so that d is 0
//! or 1. What differs from that is decided as follows.
//!
//! - `1 < d < loop / 2`: time moved on by `d`. (Data may be lost; what is left is dated correctly.)
//! - `d >= loop / 2`: either a damaged word, or data of more than half a loop is lost. The word is ignored and events are
//!   skipped until the next time word. If that one goes on from `old`, the word was damaged. If it is as far off, data
//!   was lost.
//! - Lost data hides whole loops. With a hint from the host's clock they are counted: the number of loops is the one that
//!   brings the device's clock to within [`TOLERANCE_US`] of the host's.
//! - Where no hint explains the jump, the place is marked as a discontinuity, and time goes on with the smallest value
//!   that is later than the last and fits the word.
//! - Where the caller says that data was lost ([`LoopClock::restart`]), the place is marked in any case.

use super::{
    anomalies::Anomalies,
    state::{BitReader, BitWriter},
};

/// How far host and device may differ, after whole loops are taken off. Transfers arrive within milliseconds; a quarter
/// of a second leaves room for a busy host and is small against the 16.8 s of the shortest loop.
pub(super) const TOLERANCE_US: i128 = 250_000;

/// Hints are cut to this, so that times stay far from overflow.
const MAX_HINT_US: u64 = 1 << 60;

/// Unwraps time words of `BITS` bits that count units of `2^SHIFT` microseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct LoopClock<const BITS: u32, const SHIFT: u32> {
    /// Time words since the beginning, loops included.
    high: u64,
    flags: Flags,
    /// The host's and the device's time at the last hint, microseconds.
    anchor: Option<(u64, u64)>,
    /// A hint that the next time word takes up.
    hint: Option<u64>,
}

/// What is known of the time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Flags {
    /// A time word came.
    pub known: bool,
    /// The last one went back and awaits its confirmation.
    pub doubt: bool,
    /// Data was lost since.
    pub restarted: bool,
}

impl Flags {
    /// Writes three bits.
    pub fn put(self, bits: &mut BitWriter) {
        for flag in [self.known, self.doubt, self.restarted] {
            bits.put(flag, 1);
        }
    }

    /// Reads three bits.
    pub fn take(bits: &mut BitReader) -> Self {
        let [known, doubt, restarted] = std::array::from_fn(|_| bits.take(1) == 1);
        Self { known, doubt, restarted }
    }
}

/// What a time word meant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Step {
    /// Time moved on continuously, or stayed.
    Continuous,
    /// The word was ignored; time is in doubt until the next one.
    Ignored,
    /// Time is known again and not continuous.
    Discontinuity,
}

impl<const BITS: u32, const SHIFT: u32> LoopClock<BITS, SHIFT> {
    const LOOP: u64 = 1 << BITS;
    /// Period of the roll-over, microseconds.
    const LOOP_US: i128 = 1 << (BITS + SHIFT);

    /// Time of the last time word, microseconds.
    #[inline(always)]
    pub fn time_us(&self) -> u64 {
        self.high << SHIFT
    }

    /// The bits of the last time word.
    #[inline(always)]
    pub fn word(&self) -> u64 {
        self.high % Self::LOOP
    }

    /// Whether the time is known at this point.
    #[inline(always)]
    pub fn dated(&self) -> bool {
        self.flags == Flags { known: true, doubt: false, restarted: false }
    }

    /// Whether a word equal to [`LoopClock::word`] changes nothing.
    #[inline(always)]
    pub fn settled(&self) -> bool {
        self.dated() && self.hint.is_none()
    }

    /// The host's clock at the arrival of what is decoded next, microseconds since any fixed moment.
    pub fn hint(&mut self, host_us: u64) {
        self.hint = Some(host_us.min(MAX_HINT_US));
    }

    /// Data was lost, or the device restarted.
    pub fn restart(&mut self) {
        self.flags.restarted = self.flags.known;
        self.flags.doubt = false;
    }

    /// Takes a time word.
    pub fn step(&mut self, word: u64, anomalies: &mut Anomalies) -> Step {
        let Flags { known, doubt, restarted } = self.flags;
        let forward = (word % Self::LOOP).wrapping_sub(self.high) % Self::LOOP;
        let plausible = forward < Self::LOOP / 2;
        self.flags = Flags { known: true, doubt: false, restarted: false };
        if !known {
            self.high = word % Self::LOOP;
            self.take_anchor();
            return Step::Continuous;
        }
        if !plausible && !restarted && !doubt {
            self.flags.doubt = true;
            anomalies.time_backward += 1;
            return Step::Ignored;
        }
        if doubt && !plausible {
            // It was no damaged word after all.
            anomalies.time_backward = anomalies.time_backward.saturating_sub(1);
        }
        self.high += forward;
        let loops = self.loops_by_host();
        if let Some(loops) = loops {
            anomalies.loops_restored += loops;
            self.high += loops << BITS;
        }
        self.take_anchor();
        if restarted || (!plausible && loops.is_none()) {
            anomalies.discontinuities += 1;
            return Step::Discontinuity;
        }
        Step::Continuous
    }

    /// Whole loops that the host's clock says are missing; `None` without a hint and if no number of loops explains the
    /// difference.
    fn loops_by_host(&self) -> Option<u64> {
        let ((host_then, device_then), host_now) = (self.anchor?, self.hint?);
        let expected = i128::from(device_then) + i128::from(host_now) - i128::from(host_then);
        let difference = expected - i128::from(self.time_us());
        let loops = (difference + Self::LOOP_US / 2).div_euclid(Self::LOOP_US);
        let explained = (difference - loops * Self::LOOP_US).abs() <= TOLERANCE_US;
        u64::try_from(loops).ok().filter(|_| explained)
    }

    fn take_anchor(&mut self) {
        if let Some(host_us) = self.hint.take() {
            self.anchor = Some((host_us, self.time_us()));
        }
    }

    /// Time words so far, and what is known of the time.
    pub fn save(&self) -> (u64, Flags) {
        (self.high, self.flags)
    }

    /// The clock as [`LoopClock::save`] gave it.
    pub fn restore(high: u64, flags: Flags) -> Self {
        Self { high, flags, ..Self::default() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    type Clock = LoopClock<12, 12>;
    const LOOP_US: u64 = 1 << 24;

    fn run(clock: &mut Clock, words: &[u64]) -> (Vec<Step>, Anomalies) {
        let mut anomalies = Anomalies::default();
        let steps = words.iter().map(|&word| clock.step(word, &mut anomalies)).collect();
        (steps, anomalies)
    }

    #[test]
    fn time_rolls_over_and_moves_on_by_less_than_half_a_loop() {
        let mut clock = Clock::default();
        let (steps, anomalies) = run(&mut clock, &[4000, 4001, 4095, 0, 1, 2048]);
        assert!(steps.iter().all(|&step| step == Step::Continuous) && anomalies.is_empty());
        assert_eq!(clock.time_us(), LOOP_US + (2048 << 12));
    }

    #[test]
    fn a_single_word_that_goes_back_is_ignored() {
        let mut clock = Clock::default();
        let (steps, anomalies) = run(&mut clock, &[1000, 999, 1001]);
        assert_eq!(steps, [Step::Continuous, Step::Ignored, Step::Continuous]);
        assert_eq!(anomalies, Anomalies { time_backward: 1, ..Anomalies::default() });
        assert_eq!(clock.time_us(), 1001 << 12);
    }

    #[test]
    fn a_jump_without_a_hint_is_a_discontinuity_once_a_second_word_confirms_it() {
        for target in [999, 10, 1000 + 2048, 4000] {
            let mut clock = Clock::default();
            let (steps, anomalies) = run(&mut clock, &[1000, target, target, target + 1]);
            assert_eq!(steps[1..], [Step::Ignored, Step::Discontinuity, Step::Continuous], "{target}");
            assert_eq!(anomalies, Anomalies { discontinuities: 1, ..Anomalies::default() });
            let loops = u64::from(target < 1000);
            assert_eq!(clock.time_us(), loops * LOOP_US + ((target + 1) << 12));
        }
    }

    #[test]
    fn the_hosts_clock_counts_the_loops_that_were_lost() {
        for lost_us in [20_000_000_u64, 2 * LOOP_US, 3600 * 1_000_000, 9_000_000] {
            let mut clock = Clock::default();
            let mut anomalies = Anomalies::default();
            clock.hint(500);
            clock.step(1000, &mut anomalies);
            let truth = (1000 << 12) + lost_us;
            let word = (truth >> 12) % 4096;
            clock.hint(500 + lost_us + 3000);
            let steps = [clock.step(word, &mut anomalies), clock.step(word, &mut anomalies)];
            assert_eq!(steps[1], Step::Continuous, "{lost_us}");
            assert_eq!(clock.time_us(), truth >> 12 << 12, "{lost_us}");
            assert_eq!(anomalies.discontinuities, 0);
        }
    }

    #[test]
    fn a_host_that_was_busy_changes_nothing() {
        let mut clock = Clock::default();
        let mut anomalies = Anomalies::default();
        for (host_us, word) in [(0, 10), (5_000_000, 11), (14_000_000, 12), (14_001_000, 13)] {
            clock.hint(host_us);
            assert_eq!(clock.step(word, &mut anomalies), Step::Continuous);
        }
        assert_eq!((clock.time_us(), anomalies), (13 << 12, Anomalies::default()));
    }

    #[test]
    fn after_a_restart_the_place_is_marked_even_if_the_host_explains_it() {
        let mut clock = Clock::default();
        let mut anomalies = Anomalies::default();
        clock.hint(0);
        clock.step(10, &mut anomalies);
        clock.restart();
        assert!(!clock.dated());
        clock.hint(LOOP_US + 4096);
        assert_eq!(clock.step(11, &mut anomalies), Step::Discontinuity);
        assert_eq!(clock.time_us(), LOOP_US + (11 << 12));
        clock.restart();
        clock.hint(2 * LOOP_US + 8_000_000);
        assert_eq!(clock.step(5, &mut anomalies), Step::Discontinuity);
        assert_eq!(clock.time_us(), 2 * LOOP_US + (5 << 12), "the smallest later time");
        assert_eq!(anomalies.discontinuities, 2);
    }
}
