//! Codecs against files that other programs wrote, and against themselves.

mod files;
mod goldens;
mod inivation;
mod numpy;
mod plausible;
mod reference;
mod roundtrip;
mod splits;
mod text;
mod words;

use erfgs_events::{Anomalies, Columns, Decoder};

/// Decodes `bytes` in pieces that end at `cuts`.
fn decode(mut decoder: impl Decoder, bytes: &[u8], cuts: &[usize]) -> (Columns, Anomalies) {
    let mut columns = Columns::default();
    let mut from = 0;
    for &to in cuts {
        decoder.decode(&bytes[from..to], &mut columns);
        from = to;
    }
    decoder.decode(&bytes[from..], &mut columns);
    decoder.finish(&mut columns);
    (columns, decoder.anomalies())
}
