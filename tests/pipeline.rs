//! The whole pipeline: the program as its user meets it, its files with the programs of others, and its mathematics against
//! oracles in Python; and the rooms as the documentation lists them.

mod command_line;
mod oracles;
mod recording;
mod rooms;
