//! Event-rate control: drops events in time when more than a number come within a period.
//!
//! Source: OpenEB 5.1.1, `gen41_erc.cpp`.

use serde_json::{Value, json};

use super::{board::Board, config::RateLimit};
use crate::event::EventError;

const STATE: u32 = 0x6000;
const INPUT: u32 = 0x6004;
const PERIOD: u32 = 0x6008;
const TARGET: u32 = 0x600C;
const ENABLE: u32 = 0x6028;
const TABLE_ACCESS: u32 = 0x602C;
const DROP_IN_TIME: u32 = 0x6050;
const DROP_COLUMNS: u32 = 0x6060;
const DROP_ROWS: u32 = 0x6070;
const TIME_TABLE: u32 = 0x6400;
const DELAY_TABLE: u32 = 0x6800;
/// Target of a controller that is off (OpenEB's default: 20 Mev/s).
const DEFAULT_TARGET: u32 = 4000;
const DEFAULT_PERIOD_US: u32 = 200;

/// Events a period for a limit.
pub(super) fn target(limit: &RateLimit) -> u32 {
    u32::try_from(limit.events_per_second * u64::from(limit.period_us) / 1_000_000).unwrap_or(u32::MAX)
}

/// Brings the controller up and sets its limit, or leaves it passing everything.
pub(super) fn write(board: &Board, limit: Option<&RateLimit>) -> Result<(), EventError> {
    board.change(STATE, 0b11, 0)?;
    board.change(INPUT, 1, 1)?;
    board.change(PERIOD, 0x3FF, limit.map_or(DEFAULT_PERIOD_US, |limit| limit.period_us))?;
    board.change(TARGET, 0x3F_FFFF, limit.map_or(DEFAULT_TARGET, target))?;
    board.change(ENABLE, 0b111, 0b011)?;
    board.change(TABLE_ACCESS, 1, 1)?;
    board.write_table(DELAY_TABLE, &[0x0808_0808; 230])?;
    board.change(TABLE_ACCESS, 1, 0)?;
    let steps: Vec<u32> = (0..256).map(|step| ((2 * step + 1) << 16) | (2 * step)).collect();
    board.write_table(TIME_TABLE, &steps)?;
    board.change(DROP_IN_TIME, 1, 0)?;
    board.change(DROP_COLUMNS, 1, 0)?;
    board.change(DROP_ROWS, 1, 0)?;
    board.change(STATE, 0b11, 1)?;
    board.change(DROP_IN_TIME, 1, u32::from(limit.is_some()))
}

/// What the sensor has now.
pub(super) fn read(board: &Board) -> Result<Value, EventError> {
    if board.read(DROP_IN_TIME)? & 1 == 0 {
        return Ok(Value::Null);
    }
    let (period, target) = (board.read(PERIOD)? & 0x3FF, board.read(TARGET)? & 0x3F_FFFF);
    let rate = u64::from(target) * 1_000_000 / u64::from(period.max(1));
    Ok(json!({ "period_us": period, "events_per_period": target, "events_per_second": rate }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn twenty_million_a_second_are_4000_in_200_microseconds() {
        assert_eq!(target(&RateLimit { events_per_second: 20_000_000, period_us: 200 }), 4000);
    }
}
