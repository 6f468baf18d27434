//! The recorder: from sources through bounded queues into one session file.
