//! The host of the trigger board, and the wires from it.

use std::{collections::VecDeque, sync::Arc};

use erfgs_base::random;
use erfgs_hardware_mocks::{
    trigger::{Board, Line},
    usb::TriggerLine,
};
use erfgs_rig::trigger::TriggerSettings;
use erfgs_session::{
    source::{Description, Outlet, Packet},
    trigger::protocol::{BAUD, Command, EXPOSURE_MIN_TICKS, TICK_HZ},
};
use serde_json::json;

use crate::world::Stepped;

/// How often the board is asked for its clock, nanoseconds.
const CLOCK_EVERY_NS: i64 = 1_000_000_000;

/// The wires that the board drives.
#[derive(Clone, Default)]
pub struct Wires {
    /// To the event cameras' trigger inputs: coded pulses.
    pub events: TriggerLine,
    /// To the frame cameras.
    pub frames: TriggerLine,
}

/// The board, its wires and its serial line.
pub struct TriggerHost {
    board: Board,
    wires: Wires,
    outlet: Arc<dyn Outlet>,
    sequence: u64,
    asked_ns: i64,
    /// What is on its way to the board.
    sent: VecDeque<(i64, Vec<u8>)>,
    /// Lines are as late as this draws.
    key: u64,
}

/// What the session says of the board.
#[must_use]
pub fn description(id: &str, settings: &TriggerSettings) -> Description {
    let metadata = json!({
        "port": "emulated",
        "tick_hz": TICK_HZ,
        "period_ticks": settings.period,
        "rate_hz": settings.rate_hz(),
        "exposure_ticks": settings.exposure,
        "exposure_us": settings.exposure_us(),
        "outputs": settings.outputs,
    });
    Description::trigger_board(id, metadata.as_object().cloned().unwrap_or_default())
}

/// How long bytes take on the line: ten bits each.
fn transmission_ns(bytes: usize) -> i64 {
    bytes as i64 * 10_000_000_000 / i64::from(BAUD)
}

impl TriggerHost {
    /// Sets the board, and starts its pulses.
    #[must_use]
    pub fn start(
        mut board: Board,
        settings: &TriggerSettings,
        wires: Wires,
        outlet: Arc<dyn Outlet>,
        now_ns: i64,
    ) -> Self {
        let commands = [
            Command::Stop,
            Command::Exposure(EXPOSURE_MIN_TICKS),
            Command::Period(settings.period),
            Command::Exposure(settings.exposure),
            Command::Outputs(settings.outputs),
            Command::Leds(settings.leds),
            Command::Start,
        ];
        for command in commands {
            board.take_output();
            board.receive(&command.encode(), now_ns);
        }
        Self { board, wires, outlet, sequence: 0, asked_ns: 0, sent: VecDeque::new(), key: 5 }
    }

    /// When a pulse comes, counted from the next one; `None` while there are none.
    #[must_use]
    pub fn rise_ns(&self, ahead: i64) -> Option<i64> {
        self.board.rise_ns(ahead)
    }

    /// Hands on what the board has said by a time.
    fn hear(&mut self, at_ns: i64) {
        let output = self.board.take_output();
        let mut end_ns = at_ns;
        for line in output.split_inclusive(|&byte| byte == b'\n') {
            end_ns += transmission_ns(line.len());
            let late = 300_000.0 * random::exponential(random::extend(self.key, self.sequence));
            self.outlet.send(Packet {
                sequence: self.sequence,
                host_ns: end_ns + 50_000 + late as i64,
                discontinuity: false,
                damaged: false,
                stamp: None,
                payload: line.to_vec().into(),
            });
            self.sequence += 1;
        }
    }
}

impl Stepped for TriggerHost {
    fn until(&mut self, now_ns: i64) {
        while let Some((at_ns, bytes)) = self.sent.pop_front_if(|(at_ns, _)| *at_ns <= now_ns) {
            self.board.receive(&bytes, at_ns);
            self.hear(at_ns);
        }
        self.board.advance(now_ns);
        let edges = self.board.take_edges();
        let rise_ns = edges.first().map_or(now_ns, |edge| edge.at_ns);
        for edge in edges {
            match edge.line {
                Line::Events => self.wires.events.push(edge.at_ns, edge.rising),
                Line::Frame(1) => self.wires.frames.push(edge.at_ns, edge.rising),
                Line::Frame(_) => {}
            }
        }
        self.hear(rise_ns);
        if now_ns - self.asked_ns >= CLOCK_EVERY_NS {
            self.asked_ns = now_ns;
            let bytes = Command::Clock(now_ns.unsigned_abs()).encode();
            self.sent.push_back((now_ns + transmission_ns(bytes.len()), bytes));
        }
    }
}
