//! Small streams written by hand from the specifications, with what they mean.

use erfgs_events::EventEncoding;
use erfgs_events::{
    Anomalies, CdEvent, Columns, Decoder, Edge, Evt2Decoder, Evt3Decoder, Evt21Decoder, SensorSize, WordOrder,
};

use super::{decode, words};

const SIZE: Option<SensorSize> = Some(SensorSize { width: 1280, height: 720 });

fn event(t_us: u64, x: u16, y: u16, on: bool) -> CdEvent {
    CdEvent { t_us, x, y, on }
}

fn evt3(words: &[u16]) -> (Columns, Anomalies) {
    let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
    decode(Evt3Decoder::new(SIZE), &bytes, &[])
}

fn evt2(words: &[u32]) -> (Columns, Anomalies) {
    let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
    decode(Evt2Decoder::new(SIZE), &bytes, &[])
}

#[test]
fn evt3_words_mean_what_prophesees_page_says() {
    let (columns, anomalies) = evt3(&words::EVT3);
    let t = 0xAB_C123;
    let found: Vec<CdEvent> = columns.iter().collect();
    let expected = [
        event(t, 5, 100, true),
        event(t, 6, 100, false),
        event(t, 1023, 100, true),
        event(t, 1024, 100, true),
        event(t, 1046, 100, true),
        event(t, 1047, 100, true),
        event(t, 1054, 100, true),
        event(t, 7, 1, false),
    ];
    assert_eq!(found, expected);
    let edges = [Edge { t_us: t, channel: 1, rising: true }, Edge { t_us: t + 1, channel: 2, rising: false }];
    assert_eq!(columns.edges, edges);
    assert_eq!(columns.monitor, [(t, 0x014, 0x745_6123), (t, 0x016, 0)]);
    assert!(anomalies.is_empty(), "{anomalies:?}");
}

#[test]
fn evt3_time_starts_low_on_a_new_high_word_and_rolls_over() {
    let (columns, anomalies) = evt3(&[0x8FFF, 0x6FFF, 0x0001, 0x2001, 0x8000, 0x2002, 0x6001, 0x2003, 0x8000, 0x2004]);
    let times: Vec<u64> = columns.t_us.clone();
    assert_eq!(times, [0xFF_FFFF, 0x100_0000, 0x100_0001, 0x100_0001]);
    assert!(anomalies.is_empty() && columns.discontinuities.is_empty());
}

#[test]
fn evt3_anomalies_are_counted_by_class() {
    let class = |words: &[u16]| evt3(words).1;
    let none = Anomalies::default();
    assert_eq!(class(&[0x0001, 0x2001]), Anomalies { undated: 1, ..none });
    assert_eq!(class(&[0x8000, 0x2001]), Anomalies { no_row: 1, ..none });
    assert_eq!(class(&[0x8000, 0x02D0, 0x2001]), Anomalies { outside: 1, ..none }, "row 720");
    assert_eq!(class(&[0x8000, 0x0000, 0x2500]), Anomalies { outside: 1, ..none }, "column 1280");
    assert_eq!(class(&[0x8000, 0x0000, 0x34FE, 0x400F]), Anomalies { outside: 2, ..none }, "columns 1278 to 1281");
    assert_eq!(class(&[0x8000, 0x0000, 0x4001]), Anomalies { no_base: 1, ..none });
    assert_eq!(class(&[0x8000, 0xE014, 0xF000, 0x6000]), Anomalies { incomplete: 1, ..none });
    assert_eq!(class(&[0x8000, 0x7000]), Anomalies { incomplete: 1, ..none });
    assert_eq!(class(&[0x8000, 0x1000, 0x9000, 0xB000, 0xC000, 0xD000]), Anomalies { unknown: 5, ..none });
    let (_, anomalies) = decode(Evt3Decoder::new(SIZE), &[0x00, 0x80, 0x01], &[]);
    assert_eq!(anomalies, Anomalies { truncated_bytes: 1, ..none });
}

#[test]
fn evt3_events_are_skipped_while_a_jump_of_time_is_in_doubt() {
    // A damaged word: the event after it has no date.
    let (columns, anomalies) = evt3(&[0x83E8, 0x0001, 0x2001, 0x8010, 0x2002, 0x83E8, 0x2003]);
    assert_eq!(columns.x, [1, 3]);
    assert_eq!(anomalies, Anomalies { undated: 1, time_backward: 1, ..Anomalies::default() });
    // A gap: marked, and time goes on.
    let (columns, anomalies) = evt3(&[0x83E8, 0x0001, 0x2001, 0x8010, 0x2002, 0x8010, 0x2003]);
    let t = 0x1010 << 12;
    assert_eq!((columns.x.as_slice(), columns.t_us[1]), ([1, 3].as_slice(), t));
    assert_eq!(columns.discontinuities, [(1, t)]);
    assert_eq!(anomalies, Anomalies { undated: 1, discontinuities: 1, ..Anomalies::default() });
}

#[test]
fn evt3_rounds_lost_with_the_data_are_counted_with_the_hosts_clock() {
    let mut decoder = Evt3Decoder::new(SIZE);
    let mut columns = Columns::default();
    let bytes = |words: &[u16]| words.iter().flat_map(|word| word.to_le_bytes()).collect::<Vec<u8>>();
    decoder.hint_host_us(7_000_000);
    decoder.decode(&bytes(&[0x8100, 0x0001, 0x2001]), &mut columns);
    // One minute later, three rounds are gone.
    decoder.restart();
    decoder.hint_host_us(67_000_000 + 900);
    let truth = (0x100 << 12) + 60_000_000_u64;
    decoder.decode(&bytes(&[0x8000 | (truth >> 12 & 0xFFF) as u16, 0x0001, 0x2001]), &mut columns);
    decoder.finish(&mut columns);
    assert_eq!(columns.t_us, [0x100 << 12, truth >> 12 << 12]);
    assert_eq!(columns.discontinuities, [(1, truth >> 12 << 12)], "data was lost all the same");
    assert_eq!(decoder.anomalies().loops_restored, 3);
}

#[test]
fn evt2_words_mean_what_prophesees_page_says() {
    let (columns, anomalies) = evt2(&words::EVT2);
    assert_eq!(columns.iter().collect::<Vec<_>>(), [event(131, 639, 479, true), event(132, 1279, 719, false)]);
    assert_eq!(columns.edges, [Edge { t_us: 133, channel: 17, rising: true }]);
    assert_eq!(columns.monitor, [(134, 0x14, 0x123_4567), (135, 0x16, 0)]);
    assert_eq!(anomalies, Anomalies { outside: 2, incomplete: 1, unknown: 1, ..Anomalies::default() });
}

#[test]
fn evt21_words_mean_what_prophesees_page_says_in_both_orders() {
    for encoding in [EventEncoding::Evt21, EventEncoding::Evt21Legacy] {
        let legacy = encoding == EventEncoding::Evt21Legacy;
        let halves =
            words::EVT21.iter().flat_map(|&(head, payload)| if legacy { [head, payload] } else { [payload, head] });
        let bytes: Vec<u8> = halves.flat_map(u32::to_le_bytes).collect();
        let order = if legacy { WordOrder::Legacy } else { WordOrder::Little };
        let (columns, anomalies) = decode(Evt21Decoder::new(order, SIZE), &bytes, &[]);
        let expected = [
            event(131, 64, 479, true),
            event(131, 95, 479, true),
            event(132, 1278, 719, false),
            event(132, 1279, 719, false),
        ];
        assert_eq!(columns.iter().collect::<Vec<_>>(), expected, "{encoding:?}");
        assert_eq!(columns.edges, [Edge { t_us: 133, channel: 1, rising: false }]);
        assert_eq!(columns.monitor, [(134, 0x14, 0x123_4567)]);
        assert!(anomalies.is_empty());
    }
}
