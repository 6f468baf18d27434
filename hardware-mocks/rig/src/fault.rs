//! What goes wrong in a take, on demand. The devices' own models do it, so that drivers and sessions see what they would see of
//! real ones.

use erfgs_hardware_mocks::{
    trigger::Faults as BoardFaults,
    usb::{Fault as CableFault, FaultKind, Faults},
};

/// Something that goes wrong. Times are seconds of the recording, as `--from` of the import counts them; pulses of the trigger
/// board are counted from 0.
#[derive(Clone, Debug, PartialEq)]
pub enum Fault {
    /// The cable of a camera is pulled, and stays out.
    Unplugged {
        /// The camera.
        camera: String,
        /// When.
        at_s: f64,
    },
    /// Pulses do not reach a camera.
    LostPulses {
        /// The camera.
        camera: String,
        /// Which.
        pulses: std::ops::Range<u64>,
    },
    /// What the board says of pulses does not reach the host.
    LostLines {
        /// Of which.
        pulses: std::ops::Range<u32>,
    },
    /// The clock of an event camera jumps, and the camera says nothing of it.
    ClockJump {
        /// The camera.
        camera: String,
        /// When.
        at_s: f64,
        /// How far, microseconds; positive: ahead.
        by_us: f64,
    },
}

/// Adds what is to go wrong with a camera. Power is on since `powered_s` when the recording begins, and since then transfers are
/// made to it.
pub(crate) fn of_camera(faults: &[Fault], id: &str, powered_s: f64, of_device: &mut Faults) {
    for fault in faults {
        match fault {
            Fault::Unplugged { camera, at_s } if camera == id => {
                let at_ms = (1e3 * (powered_s + at_s)) as u64;
                of_device.schedule.push(CableFault { at_ms, kind: FaultKind::Unplug { for_ms: 0 } });
            }
            Fault::LostPulses { camera, pulses } if camera == id => of_device.dropped_triggers.extend(pulses.clone()),
            Fault::ClockJump { camera, at_s, by_us } if camera == id => {
                of_device.clock.jump_at_s = powered_s + at_s;
                of_device.clock.jump_us = *by_us;
            }
            _ => {}
        }
    }
}

/// What is to go wrong with the board.
pub(crate) fn of_board(faults: &[Fault]) -> BoardFaults {
    let mut of_board = BoardFaults::default();
    for fault in faults {
        if let Fault::LostLines { pulses } = fault {
            of_board.dropped_lines.extend(pulses.clone());
        }
    }
    of_board
}
