//! Where the pieces of a stream begin and end changes nothing, and a decoder can be put to sleep at any byte.

use erfgs_events::EventEncoding;
use erfgs_events::{
    Aedat2Chip, Aedat2Decoder, Anomalies, Columns, CsvDecoder, DatDecoder, DatFormat, DatItems, DavisDecoder,
    DavisLayout, Decoder, EsDecoder, EsKind, SensorSize, StreamDecoder,
};
use proptest::prelude::*;

use super::decode;

const SIZE: Option<SensorSize> = Some(SensorSize { width: 1280, height: 720 });
const DEVICES: [EventEncoding; 5] =
    [EventEncoding::Evt2, EventEncoding::Evt21, EventEncoding::Evt21Legacy, EventEncoding::Evt3, EventEncoding::Davis];

fn decoder(encoding: EventEncoding) -> StreamDecoder {
    StreamDecoder::new(encoding, SIZE)
}

/// Words that a sensor might send, with all types and some nonsense among them.
fn evt3_words() -> impl Strategy<Value = Vec<u8>> {
    let content = 0_u16..4096;
    let word = prop_oneof![
        6 => (prop_oneof![Just(0_u16), Just(2), Just(6)], content.clone()).prop_map(|(kind, content)| {
            kind << 12 | if kind == 0 { content % 730 } else { content }
        }),
        3 => (prop_oneof![Just(3_u16), Just(4), Just(4), Just(5)], content.clone())
            .prop_map(|(kind, content)| kind << 12 | content),
        3 => (0_u16..3).prop_map(|high| 0x8000 | (4000 + high)),
        1 => content.clone().prop_map(|content| 0x8000 | content),
        2 => prop_oneof![Just(0xE014_u16), Just(0xF123), Just(0xF456), Just(0x7007)],
        1 => any::<u16>(),
    ];
    // Rows as sensors send them that see much at once.
    let vectors = (0_u16..4096, any::<[u16; 3]>())
        .prop_map(|(base, [a, b, c])| vec![0x3000 | base, 0x4000 | a >> 4, 0x4000 | b >> 4, 0x5000 | c >> 8]);
    let row = (proptest::option::weighted(0.9, 0_u16..740), proptest::collection::vec(vectors, 1..5))
        .prop_map(|(row, vectors)| row.into_iter().chain(vectors.concat()).collect::<Vec<u16>>());
    let groups = prop_oneof![
        6 => word.prop_map(|word| vec![word]),
        1 => content.prop_map(|content| vec![0xE000 | content, 0xF111, 0xF222, 0x7003]),
        1 => proptest::collection::vec(row, 1..9).prop_map(|rows| rows.concat()),
        3 => (0_u16..1300, 0_u16..740).prop_map(|(x, y)| vec![0x8FA0, 0x8FA0, 0x6000 | x, y, 0x2000 | x]),
    ];
    proptest::collection::vec(groups, 0..120)
        .prop_map(|groups| groups.concat().into_iter().flat_map(u16::to_le_bytes).collect())
}

/// Words of 4 bytes with the types that EVT 2 and 2.1 have.
fn evt2_words() -> impl Strategy<Value = Vec<u8>> {
    let word = prop_oneof![
        10 => (0_u32..2, any::<u32>()).prop_map(|(kind, content)| kind << 28 | content & 0xFDF_FDFF),
        3 => (0_u32..3).prop_map(|high| 0x8000_0000 | high),
        1 => any::<u32>(),
        1 => prop_oneof![Just(0xE000_0014_u32), Just(0xF000_1234), Just(0xA000_0101)],
    ];
    proptest::collection::vec(word, 0..200).prop_map(|words| words.into_iter().flat_map(u32::to_le_bytes).collect())
}

/// Words of a DAVIS without frames and inertial samples, which its state does not hold.
fn davis_words() -> impl Strategy<Value = Vec<u8>> {
    let word = prop_oneof![
        3 => (0_u16..0x8000).prop_map(|low| 0x8000 | low),
        2 => (0_u16..300).prop_map(|row| 0x1000 | row),
        6 => (2_u16..4, 0_u16..1300).prop_map(|(kind, column)| kind << 12 | column),
        1 => (0_u16..5).prop_map(|wraps| 0x7000 | wraps),
        1 => prop_oneof![Just(1_u16), Just(2), Just(3), Just(4), Just(16), Just(17), Just(0x6000), Just(99)],
    ];
    proptest::collection::vec(word, 0..300).prop_map(|words| words.into_iter().flat_map(u16::to_le_bytes).collect())
}

fn streams() -> impl Strategy<Value = (EventEncoding, Vec<u8>)> {
    let evt2 = (
        prop_oneof![Just(EventEncoding::Evt2), Just(EventEncoding::Evt21), Just(EventEncoding::Evt21Legacy)],
        evt2_words(),
    );
    let noise = (proptest::sample::select(&DEVICES[..4]), proptest::collection::vec(any::<u8>(), 0..400));
    let davis = (Just(EventEncoding::Davis), davis_words());
    prop_oneof![4 => (Just(EventEncoding::Evt3), evt3_words()), 3 => evt2, 2 => davis, 1 => noise]
}

/// Decoders of files, and bytes for them.
fn files() -> impl Strategy<Value = (StreamDecoder, Vec<u8>)> {
    let dat = |version, items| StreamDecoder::Dat(DatDecoder::new(DatFormat { version, items, size: SIZE }));
    let decoders = vec![
        dat(1, DatItems::Events),
        dat(2, DatItems::Events),
        dat(2, DatItems::Triggers),
        StreamDecoder::Davis(DavisDecoder::new(DavisLayout::default())),
        StreamDecoder::Aedat2(Aedat2Decoder::new(Aedat2Chip::Dvs128)),
        StreamDecoder::Es(EsDecoder::new(EsKind::Dvs, SensorSize { width: 600, height: 400 })),
        StreamDecoder::Es(EsDecoder::new(EsKind::Atis, SensorSize { width: 600, height: 400 })),
        StreamDecoder::Aedat2(Aedat2Decoder::new(Aedat2Chip::Davis(SensorSize { width: 346, height: 260 }))),
    ];
    let noise = (proptest::sample::select(decoders), proptest::collection::vec(any::<u8>(), 0..200));
    let lines = proptest::collection::vec("([0-9]{1,6},[0-9]{1,4},[0-9]{1,3},[01]|-1|#|x,y| {0,300})(\r?\n)?", 0..12);
    let csv = lines.prop_map(|lines| (StreamDecoder::Csv(CsvDecoder::new(SIZE)), lines.concat().into_bytes()));
    prop_oneof![noise, csv]
}

#[test]
fn a_long_line_that_a_restart_cuts_off_counts_as_its_bytes_however_they_came() {
    for pieces in [&[300][..], &[100, 200], &[200, 100], &[1, 298, 1]] {
        let mut decoder = CsvDecoder::new(SIZE);
        let mut columns = Columns::default();
        pieces.iter().for_each(|&length| decoder.decode(&vec![b'7'; length], &mut columns));
        decoder.restart();
        decoder.decode(b"5,6,7,1\n", &mut columns);
        decoder.finish(&mut columns);
        let expected = Anomalies { truncated_bytes: 300, ..Anomalies::default() };
        assert_eq!((columns.t_us.as_slice(), decoder.anomalies()), (&[5][..], expected), "{pieces:?}");
    }
}

proptest! {
    #[test]
    fn cutting_a_file_anywhere_changes_nothing((decoder, bytes) in files()) {
        let whole = decode(decoder.clone(), &bytes, &[]);
        for cut in 0..=bytes.len() {
            prop_assert_eq!(&decode(decoder.clone(), &bytes, &[cut]), &whole, "cut at byte {}", cut);
        }
        let every_byte: Vec<usize> = (0..bytes.len()).collect();
        prop_assert_eq!(&decode(decoder, &bytes, &every_byte), &whole);
    }

    #[test]
    fn cutting_the_stream_anywhere_changes_nothing((encoding, bytes) in streams()) {
        let whole = decode(decoder(encoding), &bytes, &[]);
        for cut in 0..=bytes.len() {
            prop_assert_eq!(&decode(decoder(encoding), &bytes, &[cut]), &whole, "cut at byte {}", cut);
        }
        let every_byte: Vec<usize> = (0..bytes.len()).collect();
        prop_assert_eq!(&decode(decoder(encoding), &bytes, &every_byte), &whole);
    }

    #[test]
    fn a_decoder_goes_on_from_its_state_at_any_byte((encoding, bytes) in streams()) {
        let whole = decode(decoder(encoding), &bytes, &[]).0;
        for cut in 0..=bytes.len() {
            let mut columns = Columns::default();
            let mut first = decoder(encoding);
            first.decode(&bytes[..cut], &mut columns);
            let state = first.state().unwrap();
            let mut second = StreamDecoder::from_state(encoding, state, SIZE).unwrap();
            prop_assert_eq!(second.state().unwrap(), state);
            second.decode(&bytes[cut..], &mut columns);
            second.finish(&mut columns);
            prop_assert_eq!(&columns, &whole, "cut at byte {}", cut);
        }
    }

    #[test]
    fn any_state_is_one_to_go_on_from(encoding in proptest::sample::select(&DEVICES[..]), state: [u8; 16], bytes: Vec<u8>) {
        let mut decoder = StreamDecoder::from_state(encoding, state, SIZE).unwrap();
        let mut columns = Columns::default();
        decoder.hint_host_us(u64::from_le_bytes(state[..8].try_into().unwrap()));
        decoder.decode(&bytes, &mut columns);
        decoder.restart();
        decoder.hint_host_us(u64::MAX);
        decoder.decode(&bytes, &mut columns);
        decoder.finish(&mut columns);
        prop_assert!(columns.iter().all(|event| event.x < 1280 && event.y < 720));
    }
}
