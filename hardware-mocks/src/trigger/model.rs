//! The board as a state machine on a virtual clock: bytes and the time in, bytes and edges out.

use std::collections::BTreeSet;

/// How the board's ticks follow true time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clock {
    /// How much too fast the crystal is at power-on, parts per million.
    pub ppm: f64,
    /// How much faster it becomes each minute, parts per million.
    pub drift_ppm_per_minute: f64,
}

impl Clock {
    /// A crystal without error.
    pub const PERFECT: Self = Self { ppm: 0.0, drift_ppm_per_minute: 0.0 };

    /// Ticks at a time since power-on.
    #[must_use]
    pub fn ticks(&self, since_ns: i64) -> i64 {
        let t = since_ns as f64;
        let ahead = 1e-6 * (self.ppm * t + self.drift_ppm_per_minute * t * t / 120e9);
        ((t + ahead) * 0.016).floor() as i64
    }

    /// The time since power-on at which a tick begins.
    #[must_use]
    pub fn time_ns(&self, tick: i64) -> i64 {
        let goal = tick as f64 / 0.016;
        let mut t = goal;
        // The rate differs from 1 by parts in ten thousand: each step gains four digits.
        for _ in 0..6 {
            t = goal - 1e-6 * (self.ppm * t + self.drift_ppm_per_minute * t * t / 120e9);
        }
        t.ceil() as i64
    }
}

/// What goes wrong. Pulses are named by their index.
#[derive(Clone, Debug, Default)]
pub struct Faults {
    /// Pulses that reach no output, though the board reports them.
    pub dropped_pulses: BTreeSet<u32>,
    /// Pulses that reach the outputs twice, 2 ms apart.
    pub doubled_pulses: BTreeSet<u32>,
    /// Pulses whose line is lost.
    pub dropped_lines: BTreeSet<u32>,
    /// Pulses whose line arrives with a wrong byte.
    pub damaged_lines: BTreeSet<u32>,
    /// The board restarts when this pulse is due.
    pub restart_at: Option<u32>,
    /// Bytes that are sent before the boot message.
    pub garbage: Vec<u8>,
}

/// A line that the board drives.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Line {
    /// The event cameras' trigger input.
    Events,
    /// Frame output 1 to 4.
    Frame(u8),
}

/// An edge on a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct LineEdge {
    /// True time, in the caller's nanoseconds.
    pub at_ns: i64,
    /// Which line.
    pub line: Line,
    /// Whether it rose.
    pub rising: bool,
}

/// The board.
#[derive(Debug)]
pub struct Board {
    clock: Clock,
    faults: Faults,
    powered_ns: i64,
    line: Vec<u8>,
    output: Vec<u8>,
    edges: Vec<LineEdge>,
    period: u32,
    exposure: u32,
    outputs: u32,
    count: u32,
    bad_lines: u32,
    /// The tick of the next pulse, while running.
    next: Option<i64>,
}

fn crc(bytes: &[u8]) -> u16 {
    let mut crc = 0_u16;
    for &byte in bytes {
        // The byte-wise form, as avr-libc's `_crc_xmodem_update` computes it.
        crc = crc.rotate_left(8) ^ u16::from(byte);
        crc ^= (crc & 0xff) >> 4;
        crc ^= crc << 12;
        crc ^= (crc & 0xff) << 5;
    }
    crc
}

impl Board {
    /// A board that is powered at `now_ns`.
    #[must_use]
    pub fn new(clock: Clock, faults: Faults, now_ns: i64) -> Self {
        let mut board = Self {
            clock,
            faults,
            powered_ns: now_ns,
            line: Vec::new(),
            output: Vec::new(),
            edges: Vec::new(),
            period: 533_333,
            exposure: 80_000,
            outputs: 15,
            count: 0,
            bad_lines: 0,
            next: None,
        };
        board.output.extend(board.faults.garbage.clone());
        board.output.push(b'\n');
        board.say("b erfgs-trigger 1 1 f42400 4 1");
        board
    }

    fn restart(&mut self, now_ns: i64) {
        let faults = Faults { restart_at: None, garbage: Vec::new(), ..self.faults.clone() };
        let edges = std::mem::take(&mut self.edges);
        let output = std::mem::take(&mut self.output);
        *self = Self::new(self.clock, faults, now_ns);
        self.edges = edges;
        self.output.splice(0..0, output);
    }

    fn say(&mut self, body: &str) {
        self.output.extend(format!("{body}*{:04x}\n", crc(body.as_bytes())).bytes());
    }

    fn tick(&self, now_ns: i64) -> i64 {
        self.clock.ticks(now_ns - self.powered_ns)
    }

    /// Takes bytes from the host.
    pub fn receive(&mut self, bytes: &[u8], now_ns: i64) {
        self.advance(now_ns);
        for &byte in bytes {
            match byte {
                b'\r' => {}
                b'\n' => {
                    let line = std::mem::take(&mut self.line);
                    if !line.is_empty() {
                        self.answer(&line, now_ns);
                    }
                }
                _ => self.line.push(byte),
            }
        }
    }

    fn answer(&mut self, line: &[u8], now_ns: i64) {
        let text = String::from_utf8_lossy(line).into_owned();
        let body = text.rsplit_once('*').filter(|(body, sum)| *sum == format!("{:04x}", crc(body.as_bytes())));
        if line.len() >= 96 || body.is_none() {
            self.bad_lines += 1;
            return self.say(if line.len() >= 96 { "-? 6" } else { "-? 1" });
        }
        let body = body.map_or("", |(body, _)| body);
        let (command, arguments) = body.split_once(' ').unwrap_or((body, ""));
        let numbers: Option<Vec<u64>> =
            arguments.split(' ').filter(|a| !a.is_empty()).map(|a| u64::from_str_radix(a, 16).ok()).collect();
        let tick = self.tick(now_ns);
        let answer = match (command, numbers.as_deref()) {
            ("identify", Some([])) => Ok(" erfgs-trigger 1 1 f42400 4".into()),
            ("period", Some(&[n])) => {
                if (16_000..=0x1000_0000).contains(&n) && u64::from(self.exposure) + 800 <= n {
                    self.period = n as u32;
                    Ok(format!(" {n:x}"))
                } else {
                    Err(4)
                }
            }
            ("exposure", Some(&[n])) => {
                if n >= 320 && n + 800 <= u64::from(self.period) {
                    self.exposure = n as u32;
                    Ok(format!(" {n:x}"))
                } else {
                    Err(4)
                }
            }
            ("outputs", Some(&[n])) if n < 16 => {
                self.outputs = n as u32;
                Ok(format!(" {n:x}"))
            }
            ("outputs", Some(&[_])) => Err(4),
            ("start", Some([])) if self.next.is_some() => Err(5),
            ("start", Some([])) => {
                self.count = 0;
                self.next = Some(tick + 32_000);
                Ok(format!(" {:x}", tick + 32_000))
            }
            ("stop", Some([])) => {
                self.next = None;
                Ok(format!(" {:x}", self.count))
            }
            ("count", Some([])) => Ok(format!(" {:x}", self.count)),
            ("leds", Some(&[a, b, c])) if a.max(b).max(c) <= 0xffff => Ok(format!(" {a:x} {b:x} {c:x}")),
            ("leds", Some(&[_, _, _])) => Err(4),
            ("clock", Some(&[token])) => Ok(format!(" {token:x} {tick:x}")),
            ("status", Some([])) => Ok(format!(
                " {} {:x} {:x} {:x} {:x} {tick:x} 0 0 {:x}",
                u8::from(self.next.is_some()),
                self.period,
                self.exposure,
                self.outputs,
                self.count,
                self.bad_lines
            )),
            (
                "identify" | "period" | "exposure" | "outputs" | "start" | "stop" | "count" | "leds" | "clock"
                | "status",
                _,
            ) => Err(3),
            _ => return self.say("-? 2"),
        };
        match answer {
            Ok(fields) => self.say(&format!("+{command}{fields}")),
            Err(error) => self.say(&format!("-{command} {error}")),
        }
    }

    /// When a pulse comes, counted from the next one, in the caller's nanoseconds; `None` while the board is stopped.
    #[must_use]
    pub fn rise_ns(&self, ahead: i64) -> Option<i64> {
        self.next.map(|tick| self.powered_ns + self.clock.time_ns(tick + ahead * i64::from(self.period)))
    }

    /// Gives every pulse that is due until `now_ns`.
    pub fn advance(&mut self, now_ns: i64) {
        while let Some(tick) = self.next.filter(|&tick| tick <= self.tick(now_ns)) {
            let rise_ns = self.powered_ns + self.clock.time_ns(tick);
            if self.faults.restart_at == Some(self.count) {
                return self.restart(rise_ns);
            }
            self.pulse(tick);
            self.next = Some(tick + i64::from(self.period));
        }
    }

    fn pulse(&mut self, tick: i64) {
        let index = self.count;
        self.count += 1;
        let copies = match () {
            () if self.faults.dropped_pulses.contains(&index) => 0,
            () if self.faults.doubled_pulses.contains(&index) => 2,
            () => 1,
        };
        let exposure = i64::from(self.exposure);
        let coded = 1280 + 640 * i64::from(symbol(index));
        let coded = if (coded - exposure).abs() < 160 && self.outputs != 0 { exposure } else { coded };
        for copy in 0..copies {
            let rise = tick + 32_000 * copy;
            let frames = (1..=4).filter(|output| self.outputs & (1 << (output - 1)) != 0);
            let lines = frames.map(|output| (Line::Frame(output), exposure)).chain([(Line::Events, coded)]);
            for (line, width) in lines {
                for (rising, tick) in [(true, rise), (false, rise + width)] {
                    self.edges.push(LineEdge { at_ns: self.powered_ns + self.clock.time_ns(tick), line, rising });
                }
            }
        }
        let from = self.output.len();
        if !self.faults.dropped_lines.contains(&index) {
            self.say(&format!("p {index:x} {tick:x} {exposure:x}"));
        }
        if self.faults.damaged_lines.contains(&index) {
            self.output[from + 2] ^= 1;
        }
    }

    /// What the board has said since this was last asked.
    pub fn take_output(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.output)
    }

    /// The edges of the pulses that began since this was last asked, in order of time.
    pub fn take_edges(&mut self) -> Vec<LineEdge> {
        let mut edges = std::mem::take(&mut self.edges);
        edges.sort_unstable();
        edges
    }
}

/// The symbol that a pulse carries on the event cameras' line.
fn symbol(index: u32) -> u32 {
    let group = (index / 8) & 0xff_ffff;
    let digits: Vec<u32> = (0..6).map(|i| (group >> (20 - 4 * i)) & 15).collect();
    match index % 8 {
        0 => 16,
        7 => digits.iter().zip([1, 3, 5, 7, 9, 11]).map(|(digit, weight)| digit * weight).sum::<u32>() % 16,
        position => digits[position as usize - 1],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ask(board: &mut Board, body: &str, now_ns: i64) -> String {
        board.take_output();
        board.receive(format!("{body}*{:04x}\n", crc(body.as_bytes())).as_bytes(), now_ns);
        String::from_utf8(board.take_output()).unwrap()
    }

    #[test]
    fn pulses_come_at_the_ticks_that_are_told() {
        let clock = Clock { ppm: 80.0, drift_ppm_per_minute: 1.0 };
        let mut board = Board::new(clock, Faults::default(), 5_000);
        assert!(ask(&mut board, "start", 1_000_000).starts_with("+start "));
        board.advance(60_000_000_000);
        let output = String::from_utf8(board.take_output()).unwrap();
        let ticks: Vec<i64> =
            output.lines().map(|line| i64::from_str_radix(line.split(' ').nth(2).unwrap(), 16).unwrap()).collect();
        let rises: Vec<i64> = board
            .take_edges()
            .into_iter()
            .filter(|edge| edge.rising && edge.line == Line::Events)
            .map(|edge| edge.at_ns)
            .collect();
        assert_eq!(ticks.len(), rises.len());
        assert!(ticks.len() > 1790 && ticks.windows(2).all(|pair| pair[1] - pair[0] == 533_333));
        // 80 to 81 ppm too fast: after a minute the pulses are 4.8 ms early.
        let minute = *rises.last().unwrap() - rises[0];
        let nominal = (rises.len() as i64 - 1) * 533_333 * 125 / 2;
        assert!((4_780_000..4_860_000).contains(&(nominal - minute)), "{}", nominal - minute);
    }

    #[test]
    fn ticks_and_times_are_inverse() {
        let clock = Clock { ppm: -100.0, drift_ppm_per_minute: 1.0 };
        for tick in [0, 1, 16_000_000, 57_600_000_000, 1_382_400_000_000] {
            assert!((clock.ticks(clock.time_ns(tick)) - tick).abs() <= 1, "{tick}");
        }
    }

    #[test]
    fn the_checksum_has_the_catalogued_check_value() {
        assert_eq!(crc(b"123456789"), 0x31c3);
    }
}
