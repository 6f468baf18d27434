//! A device's words as they lie in a RAW file, cut into packets.

use std::{
    fs::File,
    io::{self, Read, Seek, SeekFrom},
};

use super::{
    host_clock::HostClock,
    packets::{Out, PACKET_BYTES, PACKET_NS},
};
use crate::container::ContainerError;
use erfgs_events::{CdEvent, Decoder, Edge, EventBatch, EventFile, Sink};

/// Bytes read at once.
const PIECE: usize = 256 << 10;
/// Bytes after which the time is looked at: a multiple of all lengths of words.
const SLICE: usize = 512;

/// Looks at the time alone.
struct Watch {
    clock: HostClock,
}

impl Sink for Watch {
    fn event(&mut self, event: CdEvent) {
        self.clock.host_ns(event.t_us);
    }

    fn events(&mut self, batch: EventBatch<'_>) {
        // Times go back by less than anybody would see here.
        if let Some(&t_us) = batch.t_us.last() {
            self.clock.host_ns(t_us);
        }
    }

    fn edge(&mut self, edge: Edge) {
        self.clock.host_ns(edge.t_us);
    }

    fn monitor(&mut self, t_us: u64, _subtype: u16, _payload: u64) {
        self.clock.host_ns(t_us);
    }

    fn discontinuity(&mut self, t_us: u64) {
        self.clock.discontinuity(t_us);
    }
}

/// Cuts the file into packets, whose words follow each other as in the file.
pub(super) fn cut(file: &EventFile, first_us: u64, out: &mut Out) -> Result<(), ContainerError> {
    let path = &file.path;
    let read_error = |offset| move |source| ContainerError::Read { path: path.clone(), offset, source };
    let mut reader =
        File::open(path).map_err(|source| ContainerError::Open { what: "open", path: path.clone(), source })?;
    reader.seek(SeekFrom::Start(file.body)).map_err(read_error(file.body))?;
    let mut decoder = file.decoder();
    let mut watch = Watch { clock: HostClock::new(first_us) };
    let (mut payload, mut begun_ns, mut offset) = (Vec::new(), 0, file.body);
    let mut piece = vec![0; PIECE];
    while out.is_wanted() {
        let count = match reader.read(&mut piece) {
            Ok(0) => break,
            Ok(count) => count,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
            Err(error) => return Err(read_error(offset)(error)),
        };
        for slice in piece[..count].chunks(SLICE) {
            decoder.decode(slice, &mut watch);
            payload.extend_from_slice(slice);
            let now_ns = watch.clock.last_ns();
            if payload.len() >= PACKET_BYTES || now_ns.saturating_sub(begun_ns) >= PACKET_NS {
                out.send(now_ns, std::mem::take(&mut payload));
                begun_ns = now_ns;
            }
        }
        offset += count as u64;
    }
    if !payload.is_empty() {
        out.send(watch.clock.last_ns(), payload);
    }
    Ok(())
}
