use std::{
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    thread::{self, JoinHandle},
    time::{Duration, Instant},
};

use erfgs_session::source::{Counters, Description, Incident, Outlet, Source, SourceError};
use serde_json::{Map, Value, json};

use super::{
    Link, TriggerConfig, TriggerError, TriggerSettings,
    find::{only, ports},
    link::{ANSWER_WAIT, ASK_AGAIN},
};
use crate::host_time::host_ns;
use erfgs_session::trigger::protocol::{Command, Identity, Message, Reply, Status};

/// How often the board's clock is asked for, and its status.
const CLOCK_EVERY: Duration = Duration::from_secs(1);
const STATUS_EVERY: Duration = Duration::from_secs(5);
/// A board that says nothing for so long, though it is asked every second, is lost.
const SILENCE: Duration = Duration::from_secs(5);
/// How often a lost board is looked for.
const RETRY_EVERY: Duration = Duration::from_millis(500);

/// A trigger board as a [`Source`] of its lines; its pulses run while the source does.
pub struct TriggerBoard {
    description: Description,
    settings: TriggerSettings,
    link: Option<Link>,
    state: Arc<State>,
    thread: Option<JoinHandle<Option<Link>>>,
}

/// What the thread shows to the owner.
#[derive(Default)]
struct State {
    stopping: AtomicBool,
    counters: Mutex<Counters>,
    readings: Mutex<Readings>,
    failure: Mutex<Option<TriggerError>>,
}

#[derive(Clone, Copy, Default)]
struct Readings {
    status: Option<Status>,
    round_trip_ns: Option<i64>,
}

fn locked<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    // Plain numbers: what another thread left is whole.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl TriggerBoard {
    /// Opens the board that the configuration names, or the only one there is, and sets it.
    ///
    /// # Errors
    /// If the configuration is out of range, there is no such board, or it refuses.
    pub fn open(config: &TriggerConfig) -> Result<Self, TriggerError> {
        let settings = config.settings()?;
        let port = if config.port.is_empty() { only(&ports())? } else { config.port.clone() };
        let (link, identity) = Link::open(&port)?;
        Self::with_link(config, settings, link, &identity)
    }

    /// As [`TriggerBoard::open`], with a board that has been greeted.
    ///
    /// # Errors
    /// If the configuration is out of range, or the board refuses.
    pub fn with_link(
        config: &TriggerConfig,
        settings: TriggerSettings,
        mut link: Link,
        identity: &Identity,
    ) -> Result<Self, TriggerError> {
        configure(&mut link, &settings, ANY_PULSE, &mut |_| {})?;
        let description = Description::trigger_board(&config.id, described(&settings, &link, identity));
        Ok(Self { description, settings, link: Some(link), state: Arc::default(), thread: None })
    }
}

fn described(settings: &TriggerSettings, link: &Link, identity: &Identity) -> Map<String, Value> {
    let table = json!({
        "port": link.name(),
        "protocol": identity.version,
        "firmware": identity.firmware,
        "tick_hz": identity.tick_hz,
        "period_ticks": settings.period,
        "rate_hz": settings.rate_hz(),
        "exposure_ticks": settings.exposure,
        "exposure_us": settings.exposure_us(),
        "outputs": settings.outputs,
        "led_half_periods_100us": settings.leds,
    });
    if let Value::Object(map) = table { map } else { Map::new() }
}

/// How long a board may take to stop: as long as the pulse under way, of which nothing is known at first.
const ANY_PULSE: Duration = Duration::from_secs(18);

/// As [`ANY_PULSE`], for a board of which the settings are ours.
fn patience(settings: &TriggerSettings) -> Duration {
    Duration::from_micros(settings.exposure_us() as u64) + ANSWER_WAIT
}

/// Stops the board and sets everything, checking each answer.
fn configure(
    link: &mut Link,
    settings: &TriggerSettings,
    patience: Duration,
    noted: &mut dyn FnMut(Message),
) -> Result<(), TriggerError> {
    link.ask_within(Command::Stop, patience, noted)?;
    let TriggerSettings { period, exposure, outputs, leds } = *settings;
    // Period and exposure must fit each other at every step: the shortest exposure fits every period.
    for (command, expected) in [
        (
            Command::Exposure(erfgs_session::trigger::protocol::EXPOSURE_MIN_TICKS),
            Reply::Exposure(erfgs_session::trigger::protocol::EXPOSURE_MIN_TICKS),
        ),
        (Command::Period(period), Reply::Period(period)),
        (Command::Exposure(exposure), Reply::Exposure(exposure)),
        (Command::Outputs(outputs), Reply::Outputs(outputs)),
        (Command::Leds(leds), Reply::Leds(leds)),
    ] {
        let answer = link.ask(command, &mut *noted)?;
        if answer != expected {
            return Err(TriggerError::Answer {
                port: link.name().to_owned(),
                command: command.to_string(),
                answer: format!("{answer:?}"),
            });
        }
    }
    Ok(())
}

impl Source for TriggerBoard {
    fn description(&self) -> &Description {
        &self.description
    }

    fn start(&mut self, outlet: Arc<dyn Outlet>) -> Result<(), SourceError> {
        if self.thread.is_some() {
            return Ok(());
        }
        let mut link = match self.link.take() {
            Some(link) => link,
            None => {
                let port = self.description.settings.get("port").and_then(Value::as_str).unwrap_or_default();
                let (mut link, _) = Link::open(port)?;
                configure(&mut link, &self.settings, ANY_PULSE, &mut |_| {})?;
                link
            }
        };
        self.state = Arc::default();
        link.forward(outlet.clone(), 0, false);
        let mut watch = Watch::new(self.settings, outlet, self.state.clone());
        // On an error the link is dropped, and opened anew by the next start.
        link.ask(Command::Start, |message| watch.note(&message))?;
        self.thread = Some(thread::Builder::new().name(self.description.id.clone()).spawn(move || watch.run(link))?);
        Ok(())
    }

    fn stop(&mut self) -> Result<(), SourceError> {
        let Some(thread) = self.thread.take() else { return Ok(()) };
        self.state.stopping.store(true, Ordering::Relaxed);
        self.link = thread.join().map_err(|_| "the trigger board's thread has panicked")?;
        locked(&self.state.failure).take().map_or(Ok(()), |error| Err(error.into()))
    }

    fn counters(&self) -> Counters {
        *locked(&self.state.counters)
    }

    fn readings(&mut self) -> Vec<(String, f64)> {
        let Readings { status, round_trip_ns } = *locked(&self.state.readings);
        let status = status.map(|status| {
            [
                ("pulses", f64::from(status.count)),
                ("late_edges", f64::from(status.late_edges)),
                ("lost_lines", f64::from(status.lost_lines)),
            ]
        });
        let round_trip = round_trip_ns.map(|ns| ("round_trip_us", ns as f64 / 1e3));
        status.into_iter().flatten().chain(round_trip).map(|(name, value)| (name.to_owned(), value)).collect()
    }
}

impl Drop for TriggerBoard {
    fn drop(&mut self) {
        if let Err(error) = self.stop() {
            tracing::warn!("while closing trigger board {}: {error}", self.description.id);
        }
    }
}

/// The thread that reads the board's lines, keeps its clock, and brings it back when it is lost.
struct Watch {
    settings: TriggerSettings,
    outlet: Arc<dyn Outlet>,
    state: Arc<State>,
    next_index: Option<u32>,
    last_tick: u64,
    restarted: bool,
    /// When the command was sent that is not answered yet: the board takes one at a time.
    under_way: Option<Instant>,
}

impl Watch {
    fn new(settings: TriggerSettings, outlet: Arc<dyn Outlet>, state: Arc<State>) -> Self {
        Self { settings, outlet, state, next_index: None, last_tick: 0, restarted: false, under_way: None }
    }

    fn note(&mut self, message: &Message) {
        if matches!(message, Message::Done(_) | Message::Refused { .. } | Message::Boot { .. }) {
            self.under_way = None;
        }
        match message {
            Message::Pulse(pulse) => {
                let missing = self.next_index.map_or(0, |next| pulse.index.wrapping_sub(next));
                // A step back is a board that started again, not four thousand million lost lines.
                if missing < u32::MAX / 2 {
                    locked(&self.state.counters).lost += u64::from(missing);
                }
                self.next_index = Some(pulse.index.wrapping_add(1));
            }
            Message::Boot { .. } => self.restarted = true,
            Message::Done(Reply::Clock { token, tick }) => {
                // Its boot message may have come damaged; a clock that goes back has restarted all the same.
                self.restarted |= *tick < self.last_tick;
                self.last_tick = *tick;
                let round_trip = host_ns().checked_sub_unsigned(*token);
                locked(&self.state.readings).round_trip_ns = round_trip;
            }
            Message::Done(Reply::Status(status)) => locked(&self.state.readings).status = Some(*status),
            Message::Done(_) | Message::Refused { .. } => {}
        }
    }

    /// Until the owner stops it. Gives the link back for the next start.
    fn run(mut self, mut link: Link) -> Option<Link> {
        loop {
            let lost = match self.stream(&mut link) {
                Ok(()) => {
                    let stopped = self.halt(&mut link);
                    self.account(&mut link);
                    return match stopped {
                        Ok(_) => Some(link),
                        Err(error) => {
                            *locked(&self.state.failure) = Some(error);
                            None
                        }
                    };
                }
                Err(reason) => reason,
            };
            self.account(&mut link);
            self.outlet.report(Incident::Lost { reason: lost });
            link = self.bring_back(link)?;
            locked(&self.state.counters).reconnections += 1;
            self.outlet.report(Incident::Back);
        }
    }

    /// Stops the pulses; asks once more if the command was lost on the way.
    fn halt(&mut self, link: &mut Link) -> Result<Reply, TriggerError> {
        while let Some(sent) = self.under_way {
            let last_look = sent.elapsed() >= ASK_AGAIN;
            for message in link.pump()? {
                self.note(&message);
            }
            if last_look && link.drained() {
                break;
            }
        }
        let patience = patience(&self.settings);
        match link.ask_within(Command::Stop, patience, &mut |message| self.note(&message)) {
            Err(TriggerError::Silent { .. } | TriggerError::Refused { .. }) => {
                link.ask_within(Command::Stop, patience, &mut |message| self.note(&message))
            }
            answer => answer,
        }
    }

    /// Reads lines until the owner stops (`Ok`), or the board is lost.
    fn stream(&mut self, link: &mut Link) -> Result<(), String> {
        let (mut clock, mut status, mut heard) = (Instant::now() - CLOCK_EVERY, Instant::now(), Instant::now());
        while !self.state.stopping.load(Ordering::Relaxed) {
            let due = if self.under_way.is_some() {
                None
            } else if clock.elapsed() >= CLOCK_EVERY {
                clock = Instant::now();
                Some(Command::Clock(host_ns().unsigned_abs()))
            } else if status.elapsed() >= STATUS_EVERY {
                status = Instant::now();
                Some(Command::Status)
            } else {
                None
            };
            if let Some(command) = due {
                self.under_way = Some(Instant::now());
                link.send(command).map_err(|error| error.to_string())?;
            }
            let asked = Instant::now();
            for message in link.pump().map_err(|error| error.to_string())? {
                self.note(&message);
                heard = Instant::now();
            }
            // What had come by then has been read: only now is a board silent, and a command unanswered.
            if link.drained() {
                self.under_way = self.under_way.filter(|sent| asked - *sent < ASK_AGAIN);
                if asked - heard > SILENCE {
                    return Err(format!(
                        "the trigger board at {} has gone silent; check its cable and supply",
                        link.name()
                    ));
                }
            }
            if std::mem::take(&mut self.restarted) {
                return Err(format!(
                    "the trigger board at {} has restarted (reset button or power supply); pulses and ticks count from 0 again",
                    link.name()
                ));
            }
            self.account(link);
        }
        Ok(())
    }

    fn account(&self, link: &mut Link) {
        let (bytes, refused) = link.take_totals();
        let mut counters = locked(&self.state.counters);
        counters.packets = link.next_sequence();
        counters.bytes += bytes;
        counters.refused += refused;
        counters.errors = counters.errors.max(link.damaged());
    }

    /// Starts the board again: over the same line if it only restarted, else by opening its port whenever it is there.
    fn bring_back(&mut self, link: Link) -> Option<Link> {
        let name = link.name().to_owned();
        let sequence = link.next_sequence();
        let mut alive = Some(link);
        while !self.state.stopping.load(Ordering::Relaxed) {
            let link = alive.take().map_or_else(|| Link::open(&name).map(|(link, _)| link), Ok);
            let restarted = link.and_then(|mut link| {
                configure(&mut link, &self.settings, patience(&self.settings), &mut |_| {})?;
                let sequence = sequence.max(link.next_sequence());
                link.forward(self.outlet.clone(), sequence, true);
                self.next_index = None;
                self.last_tick = 0;
                self.under_way = None;
                self.restarted = false;
                link.ask(Command::Start, |message| self.note(&message))?;
                Ok(link)
            });
            match restarted {
                Ok(link) => return Some(link),
                Err(error) => tracing::debug!("trigger board not back yet: {error}"),
            }
            thread::sleep(RETRY_EVERY);
        }
        None
    }
}
