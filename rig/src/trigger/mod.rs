//! The trigger board: its line protocol over a serial port.
