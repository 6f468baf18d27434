//! The two filters of the event pipeline: flickering light, and trails.
//!
//! Sources: OpenEB 5.1.1, `antiflicker_filter.cpp`, `imx636_event_trail_filter_module.cpp`, `imx636_registermap.h`.

use super::{
    board::Board,
    config::{AntiFlicker, AntiFlickerMode, TrailFilter, TrailKind},
};
use crate::event::EventError;

const FLICKER_PIPELINE: u32 = 0xC000;
const FLICKER_PARAMETERS: u32 = 0xC004;
const FLICKER_PERIODS: u32 = 0xC008;
const FLICKER_INVALIDATION: u32 = 0xC0C0;
const FLICKER_STATE: u32 = 0xC0C4;
const TRAIL_PIPELINE: u32 = 0xD000;
const TRAIL_STC: u32 = 0xD004;
const TRAIL_TRAIL: u32 = 0xD008;
const TRAIL_TIMESTAMPS: u32 = 0xD00C;
const TRAIL_INVALIDATION: u32 = 0xD0C0;
const TRAIL_STATE: u32 = 0xD0C4;

/// Values of both pipeline registers.
const BYPASS: u32 = 0b101;
const RUN: u32 = 0b001;
/// The memory of a filter is initialised.
const READY: u32 = 1 << 2;

fn wait_until_ready(board: &Board, register: u32, filter: &str) -> Result<(), EventError> {
    for _ in 0..10 {
        if board.read(register)? & READY != 0 {
            return Ok(());
        }
        board.transport.wait(std::time::Duration::from_millis(1));
    }
    Err(EventError::Answer {
        camera: board.name.clone(),
        step: format!("initialise the {filter} filter"),
        problem: format!("register {register:#06x} does not report that its memory is ready"),
    })
}

/// The filter's period of a frequency, in units of 128 µs.
fn period(hz: u32) -> u32 {
    (1_000_000 / hz.max(1)) >> 7
}

/// The part of a period that the light is off, in sixteenths; at most 15.
fn inverted_duty_cycle(percent: f64) -> u32 {
    (16.0 * (100.0 - percent) / 100.0).round().clamp(0.0, 15.0) as u32
}

/// Sets or bypasses the flicker filter.
pub(super) fn write_anti_flicker(board: &Board, filter: Option<&AntiFlicker>) -> Result<(), EventError> {
    board.write(FLICKER_PIPELINE, BYPASS)?;
    let Some(filter) = filter else { return Ok(()) };
    wait_until_ready(board, FLICKER_STATE, "flicker")?;
    board.change(FLICKER_INVALIDATION, 0xFFF, 1630)?;
    let periods =
        period(filter.high_hz) | period(filter.low_hz) << 8 | inverted_duty_cycle(filter.duty_cycle_percent) << 16;
    board.change(FLICKER_PERIODS, 0xF_FFFF, periods)?;
    let invert = u32::from(filter.mode == AntiFlickerMode::BandPass);
    // Counters of the hysteresis: a pixel counts as flickering from 6 periods on, until it has missed down to 4.
    board.change(FLICKER_PARAMETERS, 0x7F, 4 | 6 << 3 | invert << 6)?;
    board.write(FLICKER_PIPELINE, RUN)
}

/// How the trail filter counts time: a step of `2^prescaler / multiplier` µs, and the time-out of the sweep that clears
/// old time stamps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Timing {
    prescaler: u32,
    multiplier: u32,
    timeout: u32,
}

/// The finest timing for a threshold.
///
/// A pixel's time stamp has 4 bits, so that it comes round after 16 steps. The threshold takes some of them, two more are
/// kept free, and what is left is the time for the sweep that clears old stamps: the filter's clock ticks once for every
/// 1/28.8 µs of it and row. Four ticks are a fixed wait, and at least 94 are needed in all. The finest step that leaves
/// them reproduces each of the 100 rows of the maker's table (which OpenEB lists and does not explain).
fn timing(threshold_ms: u32) -> Timing {
    let threshold = u64::from(threshold_ms) * 1000;
    let mut finest: Option<(u64, u64, Timing)> = None;
    for prescaler in 0..=17_u32 {
        for multiplier in (1..16_u64).step_by(2) {
            let power = 1_u64 << prescaler;
            // threshold / step, to the nearest.
            let taken = (2 * threshold * multiplier + power) / (2 * power);
            let Some(free) = 14_u64.checked_sub(taken).filter(|&free| free > 0) else { continue };
            let sweep = (free * (power / multiplier) * 10).saturating_sub(1) / 288;
            let finer = finest.is_none_or(|(best, by, _)| power * by < best * multiplier);
            if sweep >= 94 && finer {
                let timeout = u32::try_from(sweep - 4).unwrap_or(0xFFF).min(0xFFF);
                let multiplier_bits = u32::try_from(multiplier).unwrap_or(1);
                finest = Some((power, multiplier, Timing { prescaler, multiplier: multiplier_bits, timeout }));
            }
        }
    }
    finest.map_or(Timing { prescaler: 13, multiplier: 1, timeout: 564 }, |(_, _, timing)| timing)
}

/// Sets or bypasses the trail filter.
pub(super) fn write_trail(board: &Board, filter: Option<&TrailFilter>) -> Result<(), EventError> {
    board.write(TRAIL_PIPELINE, BYPASS)?;
    let Some(filter) = filter else { return Ok(()) };
    // The flag clears when it is written as 1; then the memory is asked to initialise.
    board.change(TRAIL_STATE, READY, READY)?;
    board.change(TRAIL_STATE, 1, 1)?;
    let threshold = (filter.threshold_ms * 1000) << 1;
    match filter.kind {
        TrailKind::Trail => {
            board.change(TRAIL_STC, 1, 0)?;
            board.change(TRAIL_TRAIL, 0xF_FFFF, 1 | threshold)?;
        }
        kind => {
            let keep = u32::from(kind == TrailKind::StcKeepTrail) << 24;
            board.change(TRAIL_STC, 1 << 24 | 0xF_FFFF, 1 | threshold | keep)?;
            board.change(TRAIL_TRAIL, 1, 0)?;
        }
    }
    let Timing { prescaler, multiplier, timeout } = timing(filter.threshold_ms);
    board.change(TRAIL_TIMESTAMPS, 1 << 16 | 0x1FF, prescaler | multiplier << 5 | 1 << 16)?;
    board.change(TRAIL_INVALIDATION, 0xFFF << 12, timeout << 12)?;
    wait_until_ready(board, TRAIL_STATE, "trail")?;
    board.write(TRAIL_PIPELINE, RUN)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn timing_is_that_of_the_makers_table() {
        // Threshold (ms), prescaler, multiplier, time-out: rows of the table in OpenEB.
        for (threshold, prescaler, multiplier, timeout) in [
            (1, 12, 15, 90),
            (2, 10, 3, 90),
            (3, 11, 5, 95),
            (4, 9, 1, 102),
            (5, 13, 15, 90),
            (6, 11, 3, 114),
            (9, 13, 9, 122),
            (10, 13, 9, 90),
            (14, 14, 13, 127),
            (15, 12, 3, 138),
            (17, 12, 3, 90),
            (18, 14, 11, 99),
            (23, 11, 1, 209),
            (24, 11, 1, 138),
            (27, 15, 15, 147),
            (30, 15, 13, 170),
            (31, 15, 13, 170),
            (35, 13, 3, 90),
            (37, 15, 11, 202),
            (40, 15, 11, 99),
            (45, 15, 9, 248),
            (50, 12, 1, 280),
            (55, 12, 1, 138),
            (63, 15, 7, 158),
            (64, 16, 13, 171),
            (74, 16, 11, 409),
            (81, 15, 5, 451),
            (88, 15, 5, 223),
            (89, 16, 9, 501),
            (98, 16, 9, 248),
            (99, 13, 1, 564),
            (100, 13, 1, 564),
        ] {
            assert_eq!(timing(threshold), Timing { prescaler, multiplier, timeout }, "{threshold} ms");
        }
    }

    #[test]
    fn every_threshold_has_a_timing_that_fits_its_fields() {
        for threshold in 1..=100 {
            let Timing { prescaler, multiplier, timeout } = timing(threshold);
            assert!(prescaler < 32 && multiplier < 16 && (90..=564).contains(&timeout), "{threshold} ms");
        }
    }

    #[test]
    fn a_band_of_50_to_520_hz_has_the_reset_values() {
        // Reset of register C008: 0x8_9C_0F (min 0x0F, max 0x9C, duty 8).
        assert_eq!(period(520) | period(50) << 8 | inverted_duty_cycle(50.0) << 16, 0x8_9C0F);
        assert_eq!(inverted_duty_cycle(1.0), 15);
        assert_eq!(inverted_duty_cycle(100.0), 0);
    }
}
