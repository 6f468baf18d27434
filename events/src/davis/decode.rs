//! The decoder of DAVIS words.

use super::{
    super::{
        Anomalies, Decoder, Mark, Sink,
        stage::Stage,
        state::{BitReader, BitWriter},
    },
    DavisLayout,
    frame::{Levels, Readout},
    imu::Reading,
};

/// Period of the roll-over of the low time, microseconds.
const LOOP_US: u64 = 1 << 15;
/// How far host and device may differ after whole roll-overs are taken off; beyond that, lost roll-overs are not counted.
const TOLERANCE_US: i128 = 8_000;
/// Times stay below this.
const MAX_US: u64 = 1 << 48;
const NO_ROW: u16 = 0xFFF;

/// Decodes the words of a DAVIS.
#[derive(Clone, Debug)]
pub struct DavisDecoder {
    layout: DavisLayout,
    /// Time up to the last roll-over.
    base_us: u64,
    t_us: u64,
    known: bool,
    restarted: bool,
    anchor: Option<(u64, u64)>,
    hint: Option<u64>,
    row: u16,
    frame: Option<Box<Readout>>,
    imu: Option<Reading>,
    carry: Option<u8>,
    anomalies: Anomalies,
    stage: Stage,
}

impl DavisDecoder {
    /// A decoder at the start of a stream.
    #[must_use]
    pub fn new(layout: DavisLayout) -> Self {
        Self {
            layout,
            base_us: 0,
            t_us: 0,
            known: false,
            restarted: false,
            anchor: None,
            hint: None,
            row: NO_ROW,
            frame: None,
            imu: None,
            carry: None,
            anomalies: Anomalies::default(),
            stage: Stage::default(),
        }
    }

    /// What the decoder remembers at this point, for [`DavisDecoder::from_state`]. Counts of anomalies, hints of the
    /// host's clock, and a frame or an inertial sample under way are not part of it: those two are lost.
    #[must_use]
    pub fn state(&self) -> [u8; 16] {
        let mut bits = BitWriter::default();
        bits.put(self.base_us >> 15, 33);
        bits.put(self.t_us % LOOP_US, 15);
        bits.put(self.known, 1);
        bits.put(self.restarted, 1);
        bits.put(self.row, 12);
        bits.carry(self.carry.as_slice(), 1);
        bits.bytes()
    }

    /// A decoder that goes on where another one gave its `state`.
    #[must_use]
    pub fn from_state(state: [u8; 16], layout: DavisLayout) -> Self {
        let mut bits = BitReader::new(state);
        let mut decoder = Self::new(layout);
        decoder.base_us = bits.take(33) << 15;
        decoder.t_us = decoder.base_us + bits.take(15);
        decoder.known = bits.take(1) == 1;
        decoder.restarted = bits.take(1) == 1;
        let row = bits.take(12) as u16;
        decoder.row = if row < decoder.event_size().1 { row } else { NO_ROW };
        decoder.carry = bits.take_carry(1).first().copied();
        decoder
    }

    fn dated(&self) -> bool {
        self.known && !self.restarted
    }

    fn word(&mut self, word: u16, sink: &mut impl Sink) {
        if word >> 15 == 1 {
            return self.time(word & 0x7FFF, sink);
        }
        let data = word & 0xFFF;
        match word >> 12 {
            0 => self.special(data, sink),
            1 => self.row = if data < self.event_size().1 { data } else { self.outside_row() },
            kind @ (2 | 3) => self.event(data, kind == 3, sink),
            4 => {
                let layout = &self.layout;
                let placed = self.frame.as_mut().is_some_and(|frame| frame.level(layout, data & 0x3FF));
                self.anomalies.incomplete += u64::from(!placed);
            }
            5 => match (data >> 8, &mut self.imu) {
                (0, Some(imu)) => self.anomalies.incomplete += u64::from(!imu.byte(data as u8)),
                (3, Some(imu)) => imu.set_scales(data as u8),
                (0 | 3, None) => self.anomalies.incomplete += 1,
                _ => self.anomalies.unknown += 1,
            },
            6 => {}
            _ => {
                self.base_us = (self.base_us + LOOP_US * u64::from(data)) % MAX_US;
                self.t_us = self.base_us;
            }
        }
    }

    /// Columns and rows as events name them.
    fn event_size(&self) -> (u16, u16) {
        let size = self.layout.size;
        if self.layout.events_transposed { (size.height, size.width) } else { (size.width, size.height) }
    }

    fn outside_row(&mut self) -> u16 {
        self.anomalies.outside += 1;
        NO_ROW
    }

    #[inline(always)]
    fn event(&mut self, column: u16, on: bool, sink: &mut impl Sink) {
        if !self.dated() {
            self.anomalies.undated += 1;
        } else if self.row == NO_ROW {
            self.anomalies.no_row += 1;
        } else if column >= self.event_size().0 {
            self.anomalies.outside += 1;
        } else {
            let (x, y) = if self.layout.events_transposed { (self.row, column) } else { (column, self.row) };
            self.stage.room(1, sink);
            self.stage.push(self.t_us, x, y, on);
        }
    }

    #[inline(always)]
    fn time(&mut self, low: u16, sink: &mut impl Sink) {
        let mut t_us = self.base_us + u64::from(low);
        if !self.known || self.restarted || self.hint.is_some() || t_us < self.t_us {
            t_us = self.unusual_time(t_us, sink);
        }
        self.t_us = t_us;
    }

    /// The first time, one after a gap or a hint, and one that goes back.
    #[cold]
    fn unusual_time(&mut self, mut t_us: u64, sink: &mut impl Sink) -> u64 {
        let backward = self.known && t_us < self.t_us;
        if self.known
            && (self.restarted || backward)
            && let Some(loops) = self.loops_by_host(t_us)
        {
            self.anomalies.loops_restored += loops;
            self.base_us += loops * LOOP_US;
            t_us += loops * LOOP_US;
        }
        if self.known && (self.restarted || t_us < self.t_us) {
            self.anomalies.time_backward += u64::from(t_us < self.t_us);
            self.anomalies.discontinuities += 1;
            self.stage.flush(sink);
            sink.discontinuity(t_us);
        }
        (self.known, self.restarted) = (true, false);
        if let Some(host_us) = self.hint.take() {
            self.anchor = Some((host_us, t_us));
        }
        t_us
    }

    fn loops_by_host(&self, t_us: u64) -> Option<u64> {
        let ((host_then, device_then), host_now) = (self.anchor?, self.hint?);
        let expected = i128::from(device_then) + i128::from(host_now) - i128::from(host_then);
        let difference = expected - i128::from(t_us);
        let period = i128::from(LOOP_US);
        let loops = (difference + period / 2).div_euclid(period);
        let explained = (difference - loops * period).abs() <= TOLERANCE_US;
        u64::try_from(loops).ok().filter(|&loops| explained && loops < MAX_US / LOOP_US)
    }

    fn special(&mut self, code: u16, sink: &mut impl Sink) {
        let mark = match code {
            1 => return self.reset(sink),
            2 => Mark::ExternalFalling,
            3 => Mark::ExternalRising,
            4 => Mark::ExternalPulse,
            16 => Mark::GeneratorFalling,
            17 => Mark::GeneratorRising,
            5 => {
                self.anomalies.incomplete += u64::from(self.imu.replace(Reading::default()).is_some());
                return;
            }
            7 => {
                let sample = self.imu.take().and_then(|reading| reading.end(&self.layout, self.t_us));
                match sample {
                    Some(sample) if self.dated() => {
                        self.stage.flush(sink);
                        sink.imu(sample);
                    }
                    Some(_) => self.anomalies.undated += 1,
                    None => self.anomalies.incomplete += 1,
                }
                return;
            }
            8 | 9 => {
                let frame = Box::new(Readout::begin(self.t_us));
                self.anomalies.incomplete += u64::from(self.frame.replace(frame).is_some());
                Mark::FrameBegin
            }
            10 => {
                match self.frame.take().and_then(|frame| frame.end(&self.layout)) {
                    Some(frame) if self.dated() => {
                        self.stage.flush(sink);
                        sink.frame(frame);
                    }
                    Some(_) => self.anomalies.undated += 1,
                    None => self.anomalies.incomplete += 1,
                }
                Mark::FrameEnd
            }
            11 | 12 => {
                let levels = if code == 11 { Levels::Reset } else { Levels::Signal };
                return self.frame.iter_mut().for_each(|frame| frame.begin_column(levels));
            }
            13 => return self.frame.iter_mut().for_each(|frame| frame.end_column()),
            14 | 15 => {
                let t_us = self.t_us;
                self.frame.iter_mut().for_each(|frame| frame.expose(code == 14, t_us));
                if code == 14 { Mark::ExposureBegin } else { Mark::ExposureEnd }
            }
            _ => {
                self.anomalies.unknown += 1;
                return;
            }
        };
        if self.dated() {
            self.stage.flush(sink);
            sink.mark(self.t_us, mark);
        } else {
            self.anomalies.undated += 1;
        }
    }

    /// The device's clock starts again from zero.
    fn reset(&mut self, sink: &mut impl Sink) {
        self.stage.flush(sink);
        if self.dated() {
            sink.mark(self.t_us, Mark::TimestampReset);
        }
        self.drop_incomplete();
        // A camera that resets its clock before it tells anything begins with that.
        let breaks = self.known;
        (self.base_us, self.t_us) = (0, 0);
        (self.known, self.restarted) = (true, false);
        (self.anchor, self.hint) = (None, None);
        if breaks {
            self.anomalies.discontinuities += 1;
            sink.discontinuity(0);
        }
    }

    fn drop_incomplete(&mut self) {
        self.anomalies.incomplete += u64::from(self.frame.take().is_some());
        self.anomalies.incomplete += u64::from(self.imu.take().is_some());
        self.row = NO_ROW;
    }
}

impl Decoder for DavisDecoder {
    fn decode(&mut self, mut bytes: &[u8], sink: &mut impl Sink) {
        if let Some(first) = self.carry
            && let [second, rest @ ..] = bytes
        {
            self.carry = None;
            self.word(u16::from_le_bytes([first, *second]), sink);
            bytes = rest;
        }
        let (words, rest) = bytes.as_chunks::<2>();
        words.iter().for_each(|&word| self.word(u16::from_le_bytes(word), sink));
        if let [last] = rest {
            self.carry = Some(*last);
        }
        self.stage.flush(sink);
    }

    fn finish(&mut self, sink: &mut impl Sink) {
        self.anomalies.truncated_bytes += u64::from(self.carry.take().is_some());
        self.drop_incomplete();
        self.stage.flush(sink);
    }

    fn restart(&mut self) {
        self.anomalies.truncated_bytes += u64::from(self.carry.take().is_some());
        self.drop_incomplete();
        self.restarted = self.known;
    }

    fn hint_host_us(&mut self, host_us: u64) {
        self.hint = Some(host_us.min(MAX_US));
    }

    fn anomalies(&self) -> Anomalies {
        self.anomalies
    }
}
