//! The lines of a board in a stream of bytes.

use super::{LINE_MAX, Message, parse};

/// Cuts a stream of bytes into lines and reads them; takes the bytes in pieces of any size.
#[derive(Clone, Debug, Default)]
pub struct Reader {
    /// The line under way, as it came.
    pub(super) line: Vec<u8>,
    /// What came before on this line was longer than any line is.
    overlong: bool,
    /// A line feed was met: what follows are whole lines.
    synchronised: bool,
    damaged: u64,
}

impl Reader {
    /// A reader that may be in the middle of a line.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Takes bytes as they came, and gives every message in them to `found`. Damaged lines are counted.
    pub fn push(&mut self, bytes: &[u8], mut found: impl FnMut(Message)) {
        self.parts(bytes, |_, message| message.into_iter().for_each(&mut found));
    }

    /// As [`Reader::push`], with the bytes: `take` is given each line as it came, with its ending, and its message, if it is not
    /// damaged; and what is longer than any line in parts, the last of which has the line feed.
    pub fn parts(&mut self, bytes: &[u8], mut take: impl FnMut(&[u8], Option<Message>)) {
        for piece in bytes.split_inclusive(|&byte| byte == b'\n') {
            let is_over = |part: &[u8]| part.ends_with(b"\n") || part.len() > LINE_MAX;
            if self.line.is_empty() && is_over(piece) {
                take(piece, self.message(piece));
                continue;
            }
            self.line.extend_from_slice(piece);
            if is_over(&self.line) {
                let mut part = std::mem::take(&mut self.line);
                take(&part, self.message(&part));
                part.clear();
                self.line = part;
            }
        }
    }

    /// The message of a part, if it is a line and not damaged.
    fn message(&mut self, part: &[u8]) -> Option<Message> {
        let Some(line) = part.strip_suffix(b"\n") else {
            self.overlong = true;
            return None;
        };
        let overlong = std::mem::take(&mut self.overlong) || line.len() > LINE_MAX;
        let line = line.strip_suffix(b"\r").unwrap_or(line);
        let message = parse(line).ok().filter(|_| !overlong);
        let is_empty = line.is_empty() && !overlong;
        self.damaged += u64::from(self.synchronised && message.is_none() && !is_empty);
        self.synchronised = true;
        message
    }

    /// Bytes were lost: what came of the line under way is left out.
    pub fn restart(&mut self) {
        self.overlong = false;
        self.line.clear();
    }

    /// Lines that were damaged, the first half line after opening not counted.
    #[must_use]
    pub fn damaged(&self) -> u64 {
        self.damaged
    }
}
