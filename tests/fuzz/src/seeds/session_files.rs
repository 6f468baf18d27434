//! Session files, and recordings of ROS 2.

use erfgs_events::EventEncoding;
use erfgs_session::{
    container::Settings,
    source::{Encoding, Packet},
};
use mcap::Compression;

use super::{Seeds, sessions};

/// Sessions: small ones, and what kills and damage leave of them.
pub fn put(seeds: &mut Seeds, evt3: &[u8], davis: &[u8]) {
    let small = sessions::small_session();
    let (mut writer, camera, _) = sessions::writer(Settings { chunk_bytes: 300, ..Settings::default() });
    let mut description = sessions::description("dv0", Encoding::Events(EventEncoding::Davis));
    (description.width, description.height) = (6, 4);
    let other = writer.add_stream(&description).unwrap();
    for sequence in 0..4 {
        let packet = sessions::packet(sequence, 0);
        for (stream, words) in [(camera, evt3), (other, davis)] {
            let payload = words.to_vec().into();
            writer.packet(stream, &Packet { payload, ..packet.clone() }).unwrap();
        }
    }
    let words = writer.finish().unwrap().sink;
    let both = |seeds: &mut Seeds, bytes: &[u8]| {
        seeds.put("container", &[&[13], bytes].concat());
        seeds.put("repair", bytes);
    };
    for session in [&small, &words] {
        let mut damaged = session.clone();
        damaged[session.len() / 2] ^= 1;
        let zeros = [&session[..session.len() / 3], &[0; 100]].concat();
        for bytes in [&session[..], &session[..session.len() - 400], &session[..session.len() / 2], &damaged, &zeros] {
            both(seeds, bytes);
        }
    }
    for encoding in ["evt3", "libcaer_cmp", "unknown"] {
        seeds.put("container", &[&[13], &sessions::ros_recording(encoding)[..]].concat());
    }
    for compression in [Compression::Lz4, Compression::Zstd] {
        let ros = sessions::compressed_ros_recording("evt3", Some(compression));
        for bytes in [&sessions::repacked(&small, compression), &ros] {
            let cut = &bytes[..bytes.len() * 2 / 3];
            let unchecked = without_checksums(bytes);
            for bytes in [&bytes[..], cut, &unchecked, &unchecked[..cut.len()]] {
                both(seeds, bytes);
            }
        }
    }
    both(seeds, &without_checksums(&words));
}

/// The same file, whose chunks' checksums say that there are none: what is changed within them is read.
fn without_checksums(bytes: &[u8]) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    let chunks = mcap::Summary::read(&bytes).unwrap().unwrap().chunk_indexes;
    for chunk in chunks {
        // Behind the record's opcode and length, two times and the uncompressed size.
        bytes[chunk.chunk_start_offset as usize + 9 + 24..][..4].fill(0);
    }
    bytes
}
