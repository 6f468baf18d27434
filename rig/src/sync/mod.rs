//! One clock: fits of device clocks to the host's, frames matched to trigger pulses.
