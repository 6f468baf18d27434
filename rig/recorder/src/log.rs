//! The latest messages to the user, and no more than that.

use std::collections::VecDeque;

use erfgs_rig::host_time::host_ns;

use super::status::{Level, Message};

/// Messages that are kept.
const KEPT: usize = 100;

/// See the module.
#[derive(Default)]
pub(super) struct Log {
    messages: VecDeque<Message>,
    count: u64,
}

impl Log {
    /// Adds a message about `stream` (empty: about the whole). What repeats the last message of a stream is left out.
    pub fn say(&mut self, level: Level, stream: &str, text: impl Into<String>) {
        let text = text.into();
        let repeats = |last: &Message| last.text == text && last.level == level;
        if self.messages.iter().rev().find(|message| message.stream == stream).is_some_and(repeats) {
            return;
        }
        match level {
            Level::Info => tracing::info!(stream, "{text}"),
            Level::Warning | Level::Error => tracing::debug!(stream, "{text}"),
        }
        self.count += 1;
        if self.messages.len() == KEPT {
            self.messages.pop_front();
        }
        let stream = stream.to_owned();
        self.messages.push_back(Message { number: self.count, host_ns: host_ns(), level, stream, text });
    }

    pub fn messages(&self) -> Vec<Message> {
        self.messages.iter().cloned().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn repeated_messages_of_a_stream_are_said_once() {
        let mut log = Log::default();
        for _ in 0..3 {
            log.say(Level::Warning, "a", "hot");
            log.say(Level::Warning, "b", "cold");
        }
        log.say(Level::Warning, "a", "cooler");
        log.say(Level::Warning, "a", "hot");
        let texts: Vec<(u64, String)> = log.messages().into_iter().map(|m| (m.number, m.stream + &m.text)).collect();
        assert_eq!(texts, [(1, "ahot".into()), (2, "bcold".into()), (3, "acooler".into()), (4, "ahot".into())]);
    }

    #[test]
    fn old_messages_go() {
        let mut log = Log::default();
        for number in 0..2 * KEPT {
            log.say(Level::Info, "", number.to_string());
        }
        assert_eq!((log.messages().len(), log.messages()[0].number), (KEPT, KEPT as u64 + 1));
    }
}
