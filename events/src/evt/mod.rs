//! Prophesee's encodings EVT 2.0, 2.1 and 3.0, and the header of the RAW files that hold them.

mod evt2;
mod evt21;
mod evt3;
mod evt3_blocks;
mod evt3_encode;
mod evt3_vectors;
mod header;

pub use evt2::{Evt2Decoder, Evt2Encoder};
pub use evt3::Evt3Decoder;
pub use evt3_encode::Evt3Encoder;
pub use evt21::{Evt21Decoder, Evt21Encoder, WordOrder};
pub(crate) use header::BYTE_ORDER_MARK;
pub use header::{RawFormat, RawHeader};
