//! EVT, DAT and the headers of their files.

use erfgs_events::{
    DatEncoder, DatFormat, Edge, EventEncoding, Evt2Encoder, Evt3Encoder, Evt21Encoder, RawHeader, WordOrder,
};

use super::{SIZE, Seeds, events, words};

/// Puts them; gives a stream of EVT 3.
pub fn put(seeds: &mut Seeds) -> Vec<u8> {
    let evt2: Vec<u8> = words::EVT2.iter().flat_map(|word| word.to_le_bytes()).collect();
    let evt3: Vec<u8> = words::EVT3.iter().flat_map(|word| word.to_le_bytes()).collect();
    let evt21 = |legacy: bool| -> Vec<u8> {
        let halves = words::EVT21.iter().flat_map(|&(head, data)| if legacy { [head, data] } else { [data, head] });
        halves.flat_map(u32::to_le_bytes).collect()
    };
    seeds.stream("evt2", 0, &evt2);
    seeds.stream("evt3", 0, &evt3);
    seeds.stream("evt21", 0, &evt21(false));
    seeds.stream("evt21", 2, &evt21(true));
    let [mut evt2, mut evt21, mut evt3, mut dat] = [const { Vec::new() }; 4];
    let mut encoders =
        (Evt2Encoder::default(), Evt21Encoder::new(WordOrder::Little), Evt3Encoder::default(), DatEncoder::default());
    for event in events() {
        encoders.0.event(event, &mut evt2).unwrap();
        encoders.1.event(event, &mut evt21).unwrap();
        encoders.2.event(event, &mut evt3).unwrap();
        encoders.3.event(event, &mut dat).unwrap();
    }
    let edge = Edge { t_us: 20_000, channel: 1, rising: true };
    encoders.0.edge(edge, &mut evt2).unwrap();
    encoders.1.edge(edge, &mut evt21).unwrap();
    encoders.2.edge(edge, &mut evt3).unwrap();
    encoders.1.finish(&mut evt21);
    encoders.2.finish(&mut evt3);
    seeds.stream("evt2", 1, &evt2);
    seeds.stream("evt21", 1, &evt21);
    seeds.stream("evt3", 1, &evt3);
    for options in 0..8 {
        seeds.stream("dat", options, &dat);
    }
    for encoding in [EventEncoding::Evt2, EventEncoding::Evt21, EventEncoding::Evt21Legacy, EventEncoding::Evt3] {
        let header = RawHeader::new(encoding, SIZE, "00050567", "2026-01-02 03:04:05").unwrap_or_default();
        seeds.put("headers", &header.with_imx636("3.9.0").encode());
    }
    seeds.put("headers", b"% evt 2.1\n% system_ID 49\n% geometry 1280x720\n% end\n");
    seeds.put("headers", &DatFormat::header(SIZE, "2026-01-02 03:04:05"));
    evt3
}
