//! The latest messages to the user, and no more than that.

use std::collections::VecDeque;

use erfgs_rig::host_time::host_ns;

use super::status::{Level, Message};

/// Messages that are kept.
const KEPT: usize = 100;
/// Characters of a message that are kept: who says more, a device or another host, has nothing more to say.
const LONGEST: usize = 1000;
/// Warnings that wait to be read; of more the oldest go.
const UNREAD: usize = 12;

/// See the module.
#[derive(Default)]
pub(super) struct Log {
    messages: VecDeque<Message>,
    /// Warnings and errors that nobody has marked as read yet.
    unread: VecDeque<Message>,
    count: u64,
}

impl Log {
    /// Adds a message about `stream` (empty: about the whole). What repeats the last message of a stream is left out.
    pub fn say(&mut self, level: Level, stream: &str, text: impl Into<String>) {
        let mut text = text.into();
        if let Some((end, _)) = text.char_indices().nth(LONGEST) {
            text.truncate(end);
            text.push('…');
        }
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
        let message = Message { number: self.count, host_ns: host_ns(), level, stream, text };
        if level != Level::Info {
            // What is said again takes the place of what was said.
            self.unread.retain(|unread| (&unread.stream, &unread.text) != (&message.stream, &message.text));
            if self.unread.len() == UNREAD {
                self.unread.pop_front();
            }
            self.unread.push_back(message.clone());
        }
        self.messages.push_back(message);
    }

    /// Somebody has read this warning.
    pub fn mark_read(&mut self, number: u64) {
        self.unread.retain(|unread| unread.number != number);
    }

    /// Warnings and errors that nobody has read, oldest first.
    pub fn unread(&self) -> Vec<Message> {
        self.unread.iter().cloned().collect()
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
    fn a_message_of_any_length_takes_little_room() {
        let mut log = Log::default();
        log.say(Level::Error, "a", "é".repeat(8 << 20));
        for kept in [&log.messages()[0].text, &log.unread()[0].text] {
            assert_eq!((kept.chars().count(), kept.ends_with('…')), (LONGEST + 1, true));
        }
    }

    #[test]
    fn old_messages_go() {
        let mut log = Log::default();
        for number in 0..2 * KEPT {
            log.say(Level::Info, "", number.to_string());
        }
        assert_eq!((log.messages().len(), log.messages()[0].number), (KEPT, KEPT as u64 + 1));
    }

    #[test]
    fn warnings_stay_until_they_are_read() {
        let mut log = Log::default();
        log.say(Level::Info, "", "started");
        log.say(Level::Warning, "a", "hot");
        log.say(Level::Error, "", "full");
        for number in 0..2 * KEPT {
            log.say(Level::Info, "", number.to_string());
        }
        let unread = |log: &Log| log.unread().iter().map(|message| message.number).collect::<Vec<_>>();
        assert_eq!(unread(&log), [2, 3]);
        log.mark_read(2);
        assert_eq!(unread(&log), [3]);
        for number in 0..2 * UNREAD {
            log.say(Level::Warning, "a", number.to_string());
        }
        assert_eq!(log.unread().len(), UNREAD);
    }
}
