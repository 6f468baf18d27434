//! The command line of erfgs.

fn main() {}
