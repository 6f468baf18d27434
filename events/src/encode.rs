//! What encoders share.

use super::sink::CdEvent;

/// Why an event cannot be written in a format.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum EncodeError {
    /// Time goes back.
    #[error("an event at {t_us} µs follows one at {before_us} µs; sort the events by time")]
    Backward {
        /// The event's time.
        t_us: u64,
        /// The time before it.
        before_us: u64,
    },
    /// The gap between two events is too long for the format.
    #[error(
        "the event at {t_us} µs comes {gap_us} µs after the one before it, and the format cannot bridge more than \
         {limit_us} µs; cut the recording there"
    )]
    Gap {
        /// The event's time.
        t_us: u64,
        /// The gap.
        gap_us: u64,
        /// The longest gap.
        limit_us: u64,
    },
    /// The format has no room for the address.
    #[error("the pixel ({x}, {y}) cannot be written: the format's addresses end at {limit}; choose another format")]
    Address {
        /// Column.
        x: u16,
        /// Row.
        y: u16,
        /// The largest column and row.
        limit: u16,
    },
    /// The format has no room for the channel.
    #[error("the trigger channel {channel} cannot be written: the format's channels end at {limit}")]
    Channel {
        /// The channel.
        channel: u8,
        /// The last one.
        limit: u8,
    },
}

impl EncodeError {
    pub(super) fn check_address(x: u16, y: u16, limit: u16) -> Result<(), Self> {
        if x.max(y) > limit { Err(Self::Address { x, y, limit }) } else { Ok(()) }
    }

    pub(super) fn check_channel(channel: u8, limit: u8) -> Result<(), Self> {
        if channel > limit { Err(Self::Channel { channel, limit }) } else { Ok(()) }
    }

    pub(super) fn check_time(before_us: u64, t_us: u64, limit_us: u64) -> Result<(), Self> {
        match t_us.checked_sub(before_us) {
            None => Err(Self::Backward { t_us, before_us }),
            Some(gap_us) if gap_us > limit_us => Err(Self::Gap { t_us, gap_us, limit_us }),
            Some(_) => Ok(()),
        }
    }
}

/// Events that follow each other and differ only in the column, within 32 columns and from left to right: what one vector
/// holds.
#[derive(Clone, Copy, Debug)]
pub(super) struct Vector {
    pub t_us: u64,
    pub y: u16,
    pub on: bool,
    /// The first column that the mask covers.
    pub base: u16,
    /// Bit i stands for column `base + i`.
    pub mask: u32,
}

impl Vector {
    /// One event in a vector whose base is a multiple of `alignment` columns.
    pub fn new(event: CdEvent, alignment: u16) -> Self {
        let CdEvent { t_us, x, y, on } = event;
        let base = x / alignment * alignment;
        Self { t_us, y, on, base, mask: 1 << (x - base) }
    }

    /// Takes the event in, if it fits.
    pub fn extend(&mut self, event: CdEvent) -> bool {
        let CdEvent { t_us, x, y, on } = event;
        let column = x.wrapping_sub(self.base);
        let fits = (t_us, y, on) == (self.t_us, self.y, self.on) && x >= self.base && column < 32;
        // Not to the left of, nor at, the last event: the order would be lost.
        let fits = fits && self.mask >> column == 0;
        if fits {
            self.mask |= 1 << column;
        }
        fits
    }
}
