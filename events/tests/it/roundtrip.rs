//! What an encoder writes, the decoder reads.

use erfgs_events::{
    CdEvent, Columns, Edge, EncodeError, Evt2Decoder, Evt2Encoder, Evt3Decoder, Evt3Encoder, Evt21Decoder,
    Evt21Encoder, WordOrder,
};
use proptest::prelude::*;

use super::decode;

#[derive(Clone, Debug)]
enum Item {
    Event(CdEvent),
    Edge(Edge),
}

/// Events and edges in order of time, many of them neighbours, from `start` on, with gaps up to `gap` microseconds.
fn items(start: u64, gap: u64) -> impl Strategy<Value = Vec<Item>> {
    let step = prop_oneof![4 => Just(0_u64), 3 => 0..100_u64, 1 => 0..gap];
    let item = (step, 0_u16..60, 0_u16..2048, 0_u16..4, any::<bool>(), 0_u8..20);
    proptest::collection::vec(item, 0..300).prop_map(move |items| {
        let (mut t_us, mut x) = (start, 0_u16);
        let mut out = Vec::new();
        for (step, dx, far, y, on, kind) in items {
            t_us += step;
            x = if dx < 50 { (x + dx / 10) % 2048 } else { far };
            out.push(match kind {
                0 => Item::Edge(Edge { t_us, channel: (y * 3) as u8, rising: on }),
                _ => Item::Event(CdEvent { t_us, x, y: y * 600, on: on && kind < 10 }),
            });
        }
        out
    })
}

fn check(items: &[Item], columns: &Columns, offset: u64) -> Result<(), TestCaseError> {
    let mut events = columns.iter();
    let mut edges = columns.edges.iter();
    for item in items {
        match item {
            Item::Event(event) => {
                prop_assert_eq!(events.next(), Some(CdEvent { t_us: event.t_us - offset, ..*event }));
            }
            Item::Edge(edge) => {
                prop_assert_eq!(edges.next(), Some(&Edge { t_us: edge.t_us - offset, ..*edge }));
            }
        }
    }
    prop_assert!(events.next().is_none() && edges.next().is_none());
    Ok(())
}

macro_rules! encode {
    ($encoder:expr, $items:expr) => {{
        let (mut encoder, mut bytes) = ($encoder, Vec::new());
        for item in $items {
            match *item {
                Item::Event(event) => encoder.event(event, &mut bytes).unwrap(),
                Item::Edge(edge) => encoder.edge(edge, &mut bytes).unwrap(),
            }
        }
        (encoder, bytes)
    }};
}

proptest! {
    #[test]
    fn evt3_comes_back_with_its_rounds_counted(items in items(16_000_000, 40_000_000)) {
        let (mut encoder, mut bytes) = encode!(Evt3Encoder::default(), &items);
        encoder.finish(&mut bytes);
        let (columns, anomalies) = decode(Evt3Decoder::new(None), &bytes, &[]);
        prop_assert!(anomalies.is_empty(), "{:?}", anomalies);
        // Rounds before the first event are not in the file.
        let first = items.first().map_or(0, |item| match item { Item::Event(e) => e.t_us, Item::Edge(e) => e.t_us });
        check(&items, &columns, first >> 24 << 24)?;
    }

    #[test]
    fn evt2_comes_back_with_its_rounds_counted(items in items(1 << 33, 1 << 34)) {
        let (_, bytes) = encode!(Evt2Encoder::default(), &items);
        let (columns, anomalies) = decode(Evt2Decoder::new(None), &bytes, &[]);
        prop_assert!(anomalies.is_empty(), "{:?}", anomalies);
        let first = items.first().map_or(0, |item| match item { Item::Event(e) => e.t_us, Item::Edge(e) => e.t_us });
        check(&items, &columns, first >> 34 << 34)?;
    }

    #[test]
    fn evt21_comes_back_with_its_rounds_counted(items in items(1 << 33, 1 << 34), legacy: bool) {
        let order = if legacy { WordOrder::Legacy } else { WordOrder::Little };
        let (mut encoder, mut bytes) = encode!(Evt21Encoder::new(order), &items);
        encoder.finish(&mut bytes);
        let (columns, anomalies) = decode(Evt21Decoder::new(order, None), &bytes, &[]);
        prop_assert!(anomalies.is_empty(), "{:?}", anomalies);
        let first = items.first().map_or(0, |item| match item { Item::Event(e) => e.t_us, Item::Edge(e) => e.t_us });
        check(&items, &columns, first >> 34 << 34)?;
    }
}

#[test]
fn what_a_format_cannot_hold_is_refused() {
    let mut out = Vec::new();
    let event = |t_us, x| CdEvent { t_us, x, y: 0, on: true };
    let mut encoder = Evt3Encoder::default();
    encoder.event(event(10_000, 0), &mut out).unwrap();
    assert_eq!(encoder.event(event(9_999, 0), &mut out), Err(EncodeError::Backward { t_us: 9_999, before_us: 10_000 }));
    assert!(matches!(encoder.event(event(10_000, 2048), &mut out), Err(EncodeError::Address { x: 2048, .. })));
    assert!(matches!(encoder.event(event(1 << 40, 0), &mut out), Err(EncodeError::Gap { .. })));
    let edge = Edge { t_us: 10_000, channel: 16, rising: true };
    assert!(matches!(encoder.edge(edge, &mut out), Err(EncodeError::Channel { channel: 16, limit: 15 })));
}
