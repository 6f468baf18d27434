//! What a camera answers instead of doing what it was told. GigE Vision and USB3 Vision number it alike.

use std::fmt;

/// The status of an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Status(pub u16);

impl Status {
    /// Another program has the control, or the register cannot be written now.
    pub const ACCESS_DENIED: Self = Self(0x8006);
    /// The camera is doing something else.
    pub const BUSY: Self = Self(0x8007);
}

impl fmt::Display for Status {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let words = match self.0 {
            0x8001 => "not implemented",
            0x8002 => "invalid parameter",
            0x8003 => "no such register",
            0x8004 => "write-protected",
            0x8005 => "bad alignment",
            0x8006 => "access denied",
            0x8007 => "busy",
            0x800b => "it took too long",
            0x800e => "invalid header",
            0x800f => "wrong configuration",
            0x8fff => "error",
            0xa001 => "it keeps no packets",
            0xa002 => "the stream's endpoint is halted",
            0xa003 => "sizes of transfers are not aligned",
            0xa004 => "sizes of transfers do not hold a frame",
            _ => return write!(f, "status {:#06x}", self.0),
        };
        write!(f, "{words} (status {:#06x})", self.0)
    }
}
