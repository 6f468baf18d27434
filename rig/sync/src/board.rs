//! The trigger board's side: its pulses, and its clock against the host's.
//!
//! A line of the board arrives after its tick, by the time that the serial line takes and a delay that is never negative:
//! the lower envelope of the arrivals is a bound of the board's clock from above. The host's `clock` commands carry the
//! time at which they were sent, before the board's tick: a bound from below. The truth lies in between, and the middle
//! is taken.

use std::collections::BTreeMap;

use erfgs_session::{
    clock::{CRYSTAL_PPM, Clock, Errors, Evidence, FitError, Sample},
    source::Packet,
};

use erfgs_session::trigger::protocol::{self, BAUD, Message, Pulse, Reader, Reply, TICK_HZ};

/// Nanoseconds of a tick.
pub const NS_PER_TICK: f64 = 1e9 / TICK_HZ as f64;
/// Rates of crystals drift with the temperature, over minutes.
const WINDOW_NS: i64 = 60_000_000_000;
/// Those of ceramic resonators do so faster. A board that is off by more than a crystal can be has one.
const RESONATOR_WINDOW_NS: i64 = 10_000_000_000;
/// Ten bits for each byte.
const NS_PER_BYTE: i64 = 10_000_000_000 / BAUD as i64;
/// An echoed time that is farther from its answer is not the host's.
const MAX_ROUND_TRIP_NS: i64 = 2_000_000_000;

/// What the board said between two resets.
#[derive(Clone, Debug, Default)]
struct Epoch {
    pulses: BTreeMap<u64, Pulse>,
    arrivals: Vec<Sample>,
    /// Ticks at which commands were received, and when they were sent, nanoseconds of session time.
    commands: Vec<Sample>,
}

/// Reads the lines of a board as they come in packets.
#[derive(Clone, Debug, Default)]
pub struct BoardLines {
    reader: Reader,
    epochs: Vec<Epoch>,
    /// Lines that do not parse, the first and cut ones included.
    pub damaged_lines: u64,
}

impl BoardLines {
    /// Takes a packet. `start_ns` is the host time of the session's zero.
    pub fn take(&mut self, packet: &Packet, start_ns: i64) {
        if packet.discontinuity {
            self.reader.restart();
        }
        let arrival = packet.host_ns.saturating_sub(start_ns);
        let Self { reader, epochs, damaged_lines } = self;
        reader.parts(&packet.payload, |line, message| match message {
            Some(message) => note(epochs, message, arrival, line.len() as i64, start_ns),
            None => *damaged_lines += u64::from(line.ends_with(b"\n")),
        });
    }

    /// The pulses and the board's clock. Of several runs between resets the one with the most pulses counts.
    ///
    /// # Errors
    /// If the board said nothing with a tick in it.
    pub fn finish(self) -> Result<Board, FitError> {
        let resets = self.epochs.len().saturating_sub(1) as u64;
        let epoch = self.epochs.into_iter().max_by_key(|epoch| epoch.pulses.len()).unwrap_or_default();
        let fit = |window_ns| Clock::fit(&epoch.arrivals, NS_PER_TICK, Evidence::Arrival, Errors::Late, window_ns);
        let mut clock = fit(WINDOW_NS)?;
        if clock.rate_error_ppm().abs() > CRYSTAL_PPM {
            clock = fit(RESONATOR_WINDOW_NS)?;
        }
        // How much earlier the clock could be before a command would be received before it was sent.
        let slack = epoch.commands.iter().map(|command| -clock.distance_ns(command)).fold(f64::INFINITY, f64::min);
        let bounds = if !slack.is_finite() {
            Bounds::OneSided
        } else if slack <= 0.0 {
            // There is no time between them, and nothing tells which of the two is wrong.
            Bounds::Disagree { by_ns: -slack }
        } else {
            let half = (slack / 2.0).round();
            for piece in &mut clock.pieces {
                piece.origin_ns = piece.origin_ns.saturating_sub(half as i64);
            }
            Bounds::Within { half_ns: half }
        };
        let mut board =
            Board { pulses: epoch.pulses, clock, bounds, resets, damaged_lines: self.damaged_lines, restored: 0 };
        board.restore();
        Ok(board)
    }
}

/// Takes note of a message, of a line of so many bytes.
fn note(epochs: &mut Vec<Epoch>, message: Message, arrival: i64, bytes: i64, start_ns: i64) {
    if matches!(message, Message::Boot { .. }) || epochs.is_empty() {
        epochs.push(Epoch::default());
    }
    let Some(epoch) = epochs.last_mut() else { return };
    let mut arrived = |tick: u64| {
        let ticks = i64::try_from(tick).unwrap_or(i64::MAX);
        epoch.arrivals.push(Sample { ticks, session_ns: arrival.saturating_sub(bytes * NS_PER_BYTE) });
        ticks
    };
    match message {
        Message::Pulse(pulse) => {
            arrived(pulse.tick);
            epoch.pulses.insert(pulse.index.into(), pulse);
        }
        Message::Done(Reply::Clock { token, tick }) => {
            let ticks = arrived(tick);
            let sent = token.cast_signed().saturating_sub(start_ns);
            if (0..MAX_ROUND_TRIP_NS).contains(&arrival.saturating_sub(sent)) {
                let command = protocol::Command::Clock(token).encode().len() as i64;
                let session_ns = sent.saturating_add(command * NS_PER_BYTE);
                epoch.commands.push(Sample { ticks, session_ns });
            }
        }
        _ => {}
    }
}

/// `step` of `steps` equal parts of what passed.
fn between(passed: u64, step: u64, steps: u64) -> u64 {
    u64::try_from(u128::from(passed) * u128::from(step) / u128::from(steps.max(1))).unwrap_or(passed)
}

/// More pulses in a row than these are not restored where their lines are lost.
const MOST_RESTORED: u64 = 1000;

/// What commands and answers say of the board's clock as a whole.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Bounds {
    /// It lies in the middle between their bounds, which are so far away to either side, nanoseconds.
    Within {
        /// Half of what lies between the bounds.
        half_ns: f64,
    },
    /// By the arrivals of lines, a command was received before it was sent: so much before, nanoseconds. What the clock is
    /// off is not known.
    Disagree {
        /// How long before.
        by_ns: f64,
    },
    /// No `clock` command was answered: the clock is late by the least delay of the line.
    OneSided,
}

/// The trigger board of a session.
#[derive(Clone, Debug)]
pub struct Board {
    /// The pulses by their index. Those at the ends whose lines were lost are missing.
    pub pulses: BTreeMap<u64, Pulse>,
    /// From the board's ticks to session time.
    pub clock: Clock,
    /// What the clock as a whole may be off. It is the same for all devices that the board triggers.
    pub bounds: Bounds,
    /// How often the board was reset.
    pub resets: u64,
    /// Lines that do not parse.
    pub damaged_lines: u64,
    /// Pulses whose lines were lost, between others that tell when they were.
    pub restored: u64,
}

impl Board {
    /// Puts in the pulses whose lines were lost: the board counts them, and counts ticks between them, always the same.
    fn restore(&mut self) {
        let period = self.period_ticks();
        let known: Vec<(u64, Pulse)> = self.pulses.iter().map(|(&index, pulse)| (index, *pulse)).collect();
        for pair in known.windows(2) {
            let [(before, a), (after, b)] = [pair[0], pair[1]];
            let steps = after - before;
            let Some(period) = period.filter(|_| (2..=MOST_RESTORED).contains(&steps) && a.width == b.width) else {
                continue;
            };
            // Of a rate that is no whole number of ticks each interval may be a tick longer.
            let passed = b.tick.saturating_sub(a.tick);
            if passed.abs_diff(period.saturating_mul(steps)) > steps {
                continue;
            }
            for step in 1..steps {
                let index = u32::try_from(before + step).unwrap_or(u32::MAX);
                self.pulses.insert(before + step, Pulse { index, tick: a.tick + between(passed, step, steps), ..a });
                self.restored += 1;
            }
        }
    }

    /// The session time of a pulse's rising edge.
    #[must_use]
    pub fn rise_ns(&self, pulse: &Pulse) -> i64 {
        self.clock.session_ns(i64::try_from(pulse.tick).unwrap_or(i64::MAX))
    }

    /// How long the frame triggers of a pulse are high, nanoseconds: the exposure of a camera that follows its trigger.
    #[must_use]
    pub fn width_ns(pulse: &Pulse) -> i64 {
        (f64::from(pulse.width) * NS_PER_TICK).round() as i64
    }

    /// The typical time from one pulse to the next, nanoseconds; `None` for fewer than two pulses.
    #[must_use]
    pub fn period_ns(&self) -> Option<i64> {
        self.period_ticks().map(|ticks| (ticks as f64 * NS_PER_TICK).round() as i64)
    }

    fn period_ticks(&self) -> Option<u64> {
        let pulses: Vec<(&u64, &Pulse)> = self.pulses.iter().collect();
        let mut periods: Vec<u64> = pulses
            .windows(2)
            .filter(|pair| *pair[1].0 == pair[0].0 + 1 && pair[1].1.tick > pair[0].1.tick)
            .map(|pair| pair[1].1.tick - pair[0].1.tick)
            .collect();
        let middle = periods.len() / 2;
        (!periods.is_empty()).then(|| *periods.select_nth_unstable(middle).1)
    }
}
