//! Arrays as programs write them: read as they are meant, or refused.

use proptest::prelude::*;

use super::*;
use crate::Event;

/// How a number is written.
type Write = fn(f64) -> Vec<u8>;

/// Numbers as NumPy has them: the type's name, and how one is written.
const TYPES: [(&str, Write); 6] = [
    ("<i8", |value| (value as i64).to_le_bytes().to_vec()),
    ("<u4", |value| (value as u32).to_le_bytes().to_vec()),
    (">i4", |value| (value as i32).to_be_bytes().to_vec()),
    ("<u2", |value| (value as u16).to_le_bytes().to_vec()),
    ("<f8", |value| value.to_le_bytes().to_vec()),
    ("<f4", |value| (value as f32).to_le_bytes().to_vec()),
];

fn array(descr: &str, count: usize, values: Vec<u8>) -> Vec<u8> {
    let header = format!("{{'descr': {descr}, 'fortran_order': False, 'shape': ({count},), }}\n");
    [&b"\x93NUMPY\x01\x00"[..], &(header.len() as u16).to_le_bytes(), header.as_bytes(), &values].concat()
}

fn events() -> impl Strategy<Value = Events> {
    let one = (1..900_i64, 0..1280_u16, 0..720_u16, any::<bool>());
    proptest::collection::vec(one, 1..30).prop_map(|rows| {
        let mut events = Events::new(1280, 720);
        let mut t_us = 0;
        for (step, x, y, on) in rows {
            t_us += step;
            events.push(Event { t_us, x, y, on });
        }
        events
    })
}

/// Times, columns, rows and polarities, where a time has `unit` microseconds.
fn columns(events: &Events, unit: f64, off: f64) -> [Vec<f64>; 4] {
    let of = |value: &dyn Fn(usize) -> f64| (0..events.len()).map(value).collect::<Vec<f64>>();
    [
        of(&|at| events.t_us[at] as f64 / unit),
        of(&|at| f64::from(events.x[at])),
        of(&|at| f64::from(events.y[at])),
        of(&|at| if events.on[at] { 1.0 } else { off }),
    ]
}

proptest! {
    #[test]
    fn archives_are_read_as_their_names_and_types_say_or_refused(
        events in events(),
        types in prop::array::uniform4(0..TYPES.len()),
        off in prop::sample::select(vec![0.0, -1.0]),
        time in prop::sample::select(vec!["t", "t_us", "t_ms", "t_ns", "ts", "time"]),
        sign in prop::sample::select(vec!["p", "pol", "polarity"]),
        more in prop::sample::select(vec!["frames", "note", "time_unit", "t_offset"]),
    ) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npz");
        let columns = columns(&events, 1.0, off);
        let mut arrays: Vec<(&str, Vec<u8>)> = std::iter::zip([time, "x", "y", sign], &columns)
            .zip(types)
            .map(|((name, values), of)| {
                let (descr, write) = TYPES[of];
                (name, array(&format!("'{descr}'"), values.len(), values.iter().flat_map(|&value| write(value)).collect()))
            })
            .collect();
        arrays.push((more, array("'<i8'", 1, vec![0; 8])));
        write(&path, &arrays).unwrap();
        let read = read_events(&path, Some([1280, 720]));
        let is_whole = types.iter().all(|&of| of < 4) && (off == 0.0 || ["<i8", ">i4"].contains(&TYPES[types[3]].0));
        let is_named = ["t", "t_us"].contains(&time) && sign == "p" && ["frames", "note"].contains(&more);
        match read {
            Ok(read) => prop_assert!(is_named && read == events, "{time} {sign} {more} {types:?}"),
            Err(error) => prop_assert!(!is_named || !is_whole, "{error}: {time} {sign} {more} {types:?}"),
        }
    }

    #[test]
    fn structured_arrays_are_read_in_any_order_and_unit_that_shows_or_refused(
        events in events(),
        order in Just([0, 1, 2, 3]).prop_shuffle(),
        types in prop::array::uniform4(0..TYPES.len()),
        off in prop::sample::select(vec![0.0, -1.0]),
        unit in prop::sample::select(vec![1.0, 1e6]),
        time in prop::sample::select(vec!["t", "t_us", "timestamp", "t_ms", "t_ns"]),
        more in prop::sample::select(vec!["", "id", "t_offset", "time_unit"]),
    ) {
        // Seconds are written with points.
        let is_real = ["<f8", "<f4"].contains(&TYPES[types[0]].0);
        prop_assume!(unit == 1.0 || TYPES[types[0]].0 == "<f8");
        prop_assume!(off == 0.0 || !TYPES[types[3]].0.contains('u'));
        let columns = columns(&events, unit, off);
        let names = [time, "x", "y", "p"];
        let mut fields: Vec<String> = order.iter().map(|&at| format!("('{}', '{}')", names[at], TYPES[types[at]].0)).collect();
        if !more.is_empty() {
            fields.push(format!("('{more}', '<i8')"));
        }
        let mut values = Vec::new();
        let rows: Vec<[f64; 4]> = (0..events.len()).map(|row| columns.each_ref().map(|column| column[row])).collect();
        for row in rows {
            order.iter().for_each(|&at| values.extend(TYPES[types[at]].1(row[at])));
            values.resize(values.len() + if more.is_empty() { 0 } else { 8 }, 0);
        }
        let bytes = array(&format!("[{}]", fields.join(", ")), events.len(), values);
        let read = structured(&bytes, Path::new("a.npy"), Some([1280, 720]));
        let is_named = ["t", "t_us", "timestamp"].contains(&time) && ["", "id"].contains(&more);
        // Whole floating-point numbers may be seconds, but where their name says what they are.
        let is_clear = !is_real || (unit == 1.0) == (time == "t_us");
        match read {
            Ok(read) if !is_clear => prop_assert!(time == "t_us" && unit == 1e6 && events.len() < 4, "{time} {read:?}"),
            Ok(read) => prop_assert!(is_named && read == events, "{time} {more} {unit} {types:?}"),
            Err(error) => prop_assert!(!is_named || !is_clear, "{error}: {time} {more} {unit} {types:?}"),
        }
    }
}
