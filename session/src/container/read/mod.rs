//! Reading: a file walked over record by record, a session by its index or from one end to the other, the files of a session as one,
//! its events decoded, and a recording of whatever format.

mod chunk;
mod decode;
mod file;
mod framing;
mod index;
mod layout;
mod mend;
mod messages;
mod packet_log;
mod parse;
mod parts;
mod recording;
mod resync;
mod session;
mod unpack;
mod walk;

pub use self::{
    decode::{hand_over, sensor_size},
    messages::{IntoMessages, Messages},
    recording::Recording,
    session::Session,
};

pub(super) use self::{
    chunk::RawMessage,
    decode::Nowhere,
    framing::Head,
    layout::{Declarations, Layout},
    parse::parse_record,
    walk::{Item, Walk},
};
