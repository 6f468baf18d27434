//! CSV, NumPy's arrays and archives.

use std::fs;

use erfgs_base::npy;
use erfgs_events::{CSV_HEADER, CdEvent, CsvEncoder, Event, Events, npz};

use super::{Seeds, events};

/// Puts them.
pub fn put(seeds: &mut Seeds) {
    let mut csv = CSV_HEADER.to_vec();
    events().into_iter().for_each(|event| CsvEncoder.event(event, &mut csv));
    seeds.stream("csv", 0, &csv);
    seeds.stream("csv", 0, b"240 180\n0.003811000 96 133 0\n1.5e-2 9.7e1 98 1\n");
    seeds.stream("csv", 0, b"x,y,p,t\n5,6,1,700\n");
    let es = b"\x01\x03\x00\x04\x00\x0a\x2c\x01\xc7\x00\xff\xfe\xff\xd6\x3f\x01\x02\x00\x7f\x00\x00\xef\x00";
    seeds.stream("es", 0, es);
    seeds.stream("es", 1, es);
    seeds.stream("csv", 1, b"# t x y p\r\n12;3\t4,-1\n5 6 7 True\n\n18446744073709551615,65534,65534,0\n1,2,3,2\n");

    let events = events();
    let shape = [events.len()];
    let arrays = [
        npy::encode(&shape, events.iter().map(|event| event.t_us as i64)),
        npy::encode(&shape, events.iter().map(|event| event.x)),
        npy::encode(&shape, events.iter().map(|event| event.y)),
        npy::encode(&shape, events.iter().map(|event| u8::from(event.on))),
        npy::encode(&[], [6_u32].into_iter()),
        npy::encode(&[], [4_u32].into_iter()),
        npy::encode(&[2, 2, 3], (0..12).map(|value: u8| value)),
        npy::encode(&[2, 2], [0.5_f64, -1.0, f64::NAN, 3.0].into_iter()),
    ];
    for array in &arrays {
        seeds.put("npy", array);
    }
    let records =
        "{'descr': [('t', '<i8'), ('', '|V1'), (('on', 'p'), '|b1')], 'fortran_order': False, 'shape': (2,), }\n";
    let length = (records.len() as u16).to_le_bytes();
    seeds.put("npy", &[b"\x93NUMPY\x01\x00", &length[..], records.as_bytes(), &[7; 20]].concat());
    seeds.put("npy", b"\x93NUMPY\x01\x00\x3b\x00{'descr': '>i2', 'fortran_order': True, 'shape': (1, 3), }\n\x00\x01\x00\x02\x00\x03");
    let with_lengths = arrays[..7].iter().flat_map(|array| [&(array.len() as u16).to_le_bytes()[..], array].concat());
    seeds.put("npz", &[&[1 | 40 << 1], &with_lengths.collect::<Vec<u8>>()[..]].concat());
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("events.npz");
    let mut columns = Events::new(6, 4);
    for CdEvent { t_us, x, y, on } in events {
        columns.push(Event { t_us: t_us as i64, x, y, on });
    }
    npz::write_events(&file, &columns).unwrap();
    seeds.put("npz", &[&[9 << 1], &fs::read(&file).unwrap()[..]].concat());
}
