use proptest::prelude::*;

use super::*;

/// The train as an event camera sees it: pulses at 30 Hz, microsecond edges.
fn train(first: u64, count: u64) -> Vec<SensedPulse> {
    (first..first + count)
        .map(|index| SensedPulse {
            rise: index as i64 * 33_333_312,
            width_ns: Some(width_ns(symbol(index)) / 1000 * 1000),
        })
        .collect()
}

/// Whether no pulse has an index that is not its own.
fn none_wrong(pulses: &[SensedPulse], decoded: &Decoded) -> bool {
    std::iter::zip(pulses, &decoded.indices)
        .all(|(pulse, index)| index.is_none_or(|i| i as i64 == pulse.rise / 33_333_312))
}

#[test]
fn the_example_of_the_protocol_holds() {
    // Group 0x00012a: digits 0 0 0 1 2 a, check digit (7·1 + 9·2 + 11·10) mod 16 = 135 mod 16 = 7.
    let symbols: Vec<u8> = (0..8).map(|position| symbol(0x12a * 8 + position)).collect();
    assert_eq!(symbols, [MARK, 0, 0, 0, 1, 2, 10, 7]);
    assert_eq!((width_ns(0), width_ns(MARK)), (80_000, 720_000));
}

#[test]
fn widths_are_read_within_16_microseconds_and_refused_beyond() {
    for symbol in 0..=MARK {
        for off in [-16_000, -1_000, 0, 1_000, 16_000] {
            assert_eq!(read_width(width_ns(symbol) + off), Some(symbol));
        }
        for off in [-17_000, 17_000, 20_000] {
            assert_eq!(read_width(width_ns(symbol) + off), None);
        }
    }
    for width in [i64::MIN / 2, -80_000, 0, 1_000, 760_000, i64::MAX / 2] {
        assert_eq!(read_width(width), None);
    }
}

#[test]
fn a_train_from_its_start_is_known_from_its_first_pulse() {
    let decoded = decode(&train(0, 100));
    assert_eq!(decoded.indices, (0..100).map(Some).collect::<Vec<_>>());
    assert_eq!((decoded.breaks, decoded.unreadable), (0, 0));
}

#[test]
fn fifteen_pulses_tell_the_index_wherever_they_begin() {
    for first in 1_000_000..1_000_016 {
        let pulses = train(first, 15);
        let decoded = decode(&pulses);
        assert_eq!(decoded.indices, (first..first + 15).map(Some).collect::<Vec<_>>(), "from {first}");
    }
}

#[test]
fn seven_pulses_tell_nothing() {
    assert!(decode(&train(803, 7)).indices.iter().all(Option::is_none));
}

#[test]
fn an_unreadable_pulse_between_whole_groups_keeps_its_index() {
    let mut pulses = train(64, 24);
    pulses[11].width_ns = None;
    let decoded = decode(&pulses);
    assert_eq!(decoded.indices, (64..88).map(Some).collect::<Vec<_>>());
    assert_eq!((decoded.breaks, decoded.unreadable), (0, 1));
}

#[test]
fn a_last_pulse_that_the_end_cuts_off_has_its_index_and_is_no_fault() {
    let mut pulses = train(0, 144);
    pulses[143].width_ns = None;
    let decoded = decode(&pulses);
    assert_eq!(decoded.indices, (0..144).map(Some).collect::<Vec<_>>());
    assert_eq!((decoded.breaks, decoded.unreadable), (0, 0));
    // A last pulse of an odd width is one, and so is a lost falling edge before it.
    pulses[143].width_ns = Some(1_000);
    pulses[100].width_ns = None;
    assert_eq!(decode(&pulses).unreadable, 2);
}

#[test]
fn a_doubled_pulse_is_noticed_and_misleads_nobody() {
    for at in 0..32 {
        let mut pulses = train(800, 32);
        let extra = SensedPulse { rise: pulses[at].rise + 2_000_000, ..pulses[at] };
        pulses.insert(at + 1, extra);
        let decoded = decode(&pulses);
        let unknown = decoded.indices.iter().filter(|index| index.is_none()).count();
        assert!(decoded.breaks + unknown > 0, "nothing shows after {at}");
        // Either twin may have the index: never another.
        assert!(none_wrong(&pulses, &decoded), "after {at}");
    }
}

#[test]
fn a_train_that_starts_again_is_one_break() {
    let mut pulses = train(0, 40);
    let later = pulses[39].rise + 500_000_000;
    pulses.extend(train(0, 40).into_iter().map(|pulse| SensedPulse { rise: pulse.rise + later, ..pulse }));
    let decoded = decode(&pulses);
    assert_eq!(decoded.indices, (0..40).chain(0..40).map(Some).collect::<Vec<_>>());
    assert_eq!(decoded.breaks, 1);
}

proptest! {
    #[test]
    fn lost_pulses_never_make_a_wrong_index(first in 0..1u64 << 26, lost in prop::collection::btree_set(0..80usize, 0..8)) {
        let mut at = 0;
        let mut pulses = train(first, 80);
        pulses.retain(|_| { at += 1; !lost.contains(&(at - 1)) });
        let decoded = decode(&pulses);
        prop_assert!(none_wrong(&pulses, &decoded));
        // Whole groups between losses are all known.
        let groups = (0..80usize).filter(|at| (first + *at as u64).is_multiple_of(8) && at + 8 <= 80);
        for at in groups.filter(|at| lost.range(at..&(at + 8)).next().is_none()) {
            let place = at - lost.range(..at).count();
            prop_assert_eq!(decoded.indices[place], Some(first + at as u64));
        }
    }

    #[test]
    fn any_widths_are_survived(widths in prop::collection::vec(prop::option::of(any::<i64>()), 0..40)) {
        let pulses: Vec<_> = widths.into_iter().enumerate()
            .map(|(at, width_ns)| SensedPulse { rise: at as i64, width_ns }).collect();
        prop_assert_eq!(decode(&pulses).indices.len(), pulses.len());
    }
}
