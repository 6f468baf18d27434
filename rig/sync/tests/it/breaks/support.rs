//! Sessions of an event camera, with or without the trigger board, whose truth is known.

use std::path::Path;

use erfgs_base::random;
use erfgs_events::EventEncoding;
use erfgs_events::{CdEvent, DavisEncoder, DavisLayout, Edge, Evt3Encoder, Mark, Sink};
use erfgs_session::trigger::{
    code,
    protocol::{Command, line},
};
use erfgs_session::{
    clock::EpochCursor,
    container::{Session, SessionStart, SessionWriter, Settings},
    source::{Description, Encoding, Packet},
};
use erfgs_sync::{StreamSync, SyncOptions, Synchronisation, synchronise};

pub const START_NS: i64 = 40_000_000_000_000;
pub const MS: i64 = 1_000_000;
const PERIOD_NS: i64 = 1_000_000_000 / 30;

/// A stretch of a camera's time. Times in nanoseconds of session time.
#[derive(Clone, Copy)]
pub struct Part {
    pub from_ns: i64,
    pub to_ns: i64,
    /// When its clock stood at zero.
    pub zero_ns: i64,
    pub ppm: f64,
    /// Whether its trigger input sees the pulses.
    pub wired: bool,
    /// Every n-th pulse arrives 2 ms late; 0: none.
    pub displaced: i64,
}

impl Part {
    fn t_us(&self, at_ns: i64) -> u64 {
        ((at_ns - self.zero_ns) as f64 * 1e-3 * (1.0 + self.ppm * 1e-6)).floor() as u64
    }
}

pub const fn part(from_s: i64, to_s: i64, zero_ns: i64, ppm: f64) -> Part {
    Part { from_ns: from_s * 1000 * MS, to_ns: to_s * 1000 * MS, zero_ns, ppm, wired: true, displaced: 0 }
}

/// The words of either camera.
enum Words {
    Evt3(Evt3Encoder),
    Davis(DavisEncoder),
}

impl Words {
    fn new(encoding: Encoding) -> Self {
        match encoding {
            Encoding::Events(EventEncoding::Davis) => Self::Davis(DavisEncoder::new(DavisLayout::default())),
            _ => Self::Evt3(Evt3Encoder::default()),
        }
    }

    fn event(&mut self, t_us: u64, out: &mut Vec<u8>) {
        let event = CdEvent { t_us, x: (t_us % 300) as u16, y: (t_us % 200) as u16, on: true };
        match self {
            Self::Evt3(encoder) => encoder.event(event, out).unwrap(),
            Self::Davis(encoder) => encoder.event(event, out).unwrap(),
        }
    }

    fn edge(&mut self, t_us: u64, rising: bool, out: &mut Vec<u8>) {
        let mark = if rising { Mark::ExternalRising } else { Mark::ExternalFalling };
        match self {
            Self::Evt3(encoder) => encoder.edge(Edge { t_us, channel: 0, rising }, out).unwrap(),
            Self::Davis(encoder) => encoder.mark(t_us, mark, out).unwrap(),
        }
    }

    fn finish(&mut self, out: &mut Vec<u8>) {
        if let Self::Evt3(encoder) = self {
            encoder.finish(out);
        }
    }
}

fn uniform(n: u64, purpose: u64) -> f64 {
    random::range(random::key(3, &[n, purpose]), 1e-9, 1.0)
}

fn packet(sequence: u64, session_ns: i64, discontinuity: bool, payload: Vec<u8>) -> Packet {
    let host_ns = START_NS + session_ns;
    Packet { sequence, host_ns, discontinuity, damaged: false, stamp: None, payload: payload.into() }
}

/// A packet a millisecond with two events, and the true times of the events. `known`: the host knows of the breaks;
/// otherwise they are in the words alone, which a DAVIS says.
pub fn camera(encoding: Encoding, parts: &[Part], known: bool) -> (Vec<Packet>, Vec<i64>) {
    let (mut packets, mut truth) = (Vec::new(), Vec::new());
    let mut words = Words::new(encoding);
    for (number, part) in parts.iter().enumerate() {
        let again = number > 0 && part.zero_ns != parts[number - 1].zero_ns;
        let mut payload = Vec::new();
        match &mut words {
            Words::Davis(davis) if again && !known => {
                let last = parts[number - 1];
                davis.mark(last.t_us(part.from_ns), Mark::TimestampReset, &mut payload).unwrap();
            }
            words if again => *words = Words::new(encoding),
            _ => {}
        }
        let mut edges = (0..).flat_map(|index| {
            let late = part.displaced > 0 && index % part.displaced.max(1) == 0;
            let rise = 500 * MS + index * PERIOD_NS + if late { 2 * MS } else { 0 };
            [(rise, true), (rise + code::width_ns(code::symbol(index as u64)), false)]
        });
        let mut edge = edges.find(|edge| edge.0 >= part.from_ns).unwrap();
        for ms in part.from_ns / MS..part.to_ns / MS {
            for at_ns in [ms * MS + 100, ms * MS + MS / 2] {
                while edge.0 <= at_ns {
                    if part.wired {
                        words.edge(part.t_us(edge.0), edge.1, &mut payload);
                    }
                    edge = edges.next().unwrap();
                }
                words.event(part.t_us(at_ns), &mut payload);
                truth.push(at_ns);
            }
            words.finish(&mut payload);
            let late = 100_000.0 - 150_000.0 * uniform(ms as u64, 0).ln();
            let first = ms == part.from_ns / MS && number > 0;
            let arrived = (ms + 1) * MS + late as i64;
            packets.push(packet(packets.len() as u64, arrived, first && known, std::mem::take(&mut payload)));
        }
    }
    (packets, truth)
}

/// The board's lines over so many seconds: pulses, and a clock command a second.
pub fn board(seconds: i64) -> Vec<Packet> {
    let tick = |ns: i64| (ns as f64 / 62.5).round() as u64;
    let mut lines: Vec<(i64, Vec<u8>)> = (0..)
        .map(|index| (index, 500 * MS + index * PERIOD_NS))
        .take_while(|&(_, rise)| rise < seconds * 1000 * MS)
        .map(|(index, rise)| (rise, line(&format!("p {index:x} {:x} 13880", tick(rise)))))
        .collect();
    for second in 0..seconds {
        let sent = second * 1000 * MS + 310 * MS;
        let token = (START_NS + sent).cast_unsigned();
        let received = sent + Command::Clock(token).encode().len() as i64 * 20_000 + 60_000;
        lines.push((received, line(&format!("+clock {token:x} {:x}", tick(received)))));
    }
    lines.sort();
    let arrived = lines.into_iter().enumerate().map(|(n, (at, bytes))| {
        let late = bytes.len() as i64 * 20_000 + 60_000 + (-200_000.0 * uniform(n as u64, 1).ln()) as i64;
        packet(n as u64, at + late, false, bytes)
    });
    arrived.collect()
}

pub fn description(id: &str, encoding: Encoding, size: [u32; 2]) -> Description {
    Description {
        id: id.into(),
        model: "simulated".into(),
        serial: String::new(),
        encoding,
        width: size[0],
        height: size[1],
        start_order: 0,
        settings: serde_json::Map::new(),
    }
}

pub fn write(path: &Path, encoding: Encoding, packets: &[Packet], board: Option<&[Packet]>) {
    let start = SessionStart { host_ns: START_NS, ..SessionStart::default() };
    let mut writer = SessionWriter::create(path, start, "", Settings::default()).unwrap();
    let size = if encoding == Encoding::Events(EventEncoding::Davis) { [346, 260] } else { [1280, 720] };
    let camera = writer.add_stream(&description("eye", encoding, size)).unwrap();
    if let Some(board) = board {
        let stream = writer.add_stream(&description("board", Encoding::TriggerLines, [0, 0])).unwrap();
        board.iter().for_each(|packet| writer.packet(stream, packet).unwrap());
    }
    packets.iter().for_each(|packet| writer.packet(camera, packet).unwrap());
    writer.finish().unwrap();
}

/// Session times of all events, as whoever uses a session finds them.
pub struct Dates<'a>(pub EpochCursor<'a>, pub Vec<i64>);

impl Sink for Dates<'_> {
    fn packet(&mut self, sequence: u64) {
        self.0.packet(sequence);
    }

    fn discontinuity(&mut self, _t_us: u64) {
        self.0.discontinuity();
    }

    fn event(&mut self, event: CdEvent) {
        self.1.push(self.0.session_ns(event.t_us).expect("every event is dated"));
    }
}

/// Records, synchronises, goes through the file, and gives what was found and the farthest that any event is off.
pub fn fitted(encoding: Encoding, parts: &[Part], known: bool, with_board: bool) -> (StreamSync, i64) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("s.mcap");
    let (packets, truth) = camera(encoding, parts, known);
    let lines = with_board.then(|| board(parts.last().unwrap().to_ns / (1000 * MS)));
    write(&path, encoding, &packets, lines.as_deref());
    let mut session = Session::open(&path).unwrap();
    let sync = synchronise(&mut session, SyncOptions::default(), |_| {}).unwrap();
    let file = folder.path().join("s.sync.json");
    sync.save(&file).unwrap();
    let found = Synchronisation::load(&file).unwrap().stream("eye").unwrap().clone();
    let mut off = 0;
    // All of it, and from 200 ms after the last break on.
    let last_part = parts.last().unwrap().from_ns + 200 * MS;
    for window in [None, Some([START_NS + last_part, i64::MAX])] {
        let mut dates = Dates(found.epochs.follow(), Vec::new());
        let (stream, _) = session.stream("eye").unwrap();
        session.decode_events(stream, window, &mut dates, |_| {}).unwrap();
        let from = truth.len() - dates.1.len();
        assert!(if window.is_none() { from == 0 } else { from > 0 && from < truth.len() }, "{from}");
        let distances = std::iter::zip(&dates.1, &truth[from..]).map(|(date, truth)| (date - truth).abs());
        off = distances.fold(off, i64::max);
    }
    (found, off)
}
