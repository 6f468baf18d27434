//! Files as programs write them: read as they are meant, or refused.

use std::path::Path;

use hdf5::{
    File, Group, H5Type, Location,
    types::{CompoundField, CompoundType, FloatSize, IntSize, TypeDescriptor, VarLenUnicode},
};
use proptest::prelude::*;

use super::open;
use crate::{CdEvent, Columns};

const OFFSET: u64 = 1_234_567_890;

/// Types of numbers. What does not fit them is not written with them.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Bool,
    I8,
    U16,
    U32,
    I64,
    U64,
    F64,
}

const WHOLE: [Kind; 3] = [Kind::U32, Kind::I64, Kind::U64];
const SIGNS: [Kind; 4] = [Kind::Bool, Kind::I8, Kind::U16, Kind::I64];

fn put(group: &Group, name: &str, kind: Kind, values: &[f64], chunk: Option<usize>) {
    fn of<T: H5Type>(group: &Group, name: &str, values: Vec<T>, chunk: Option<usize>) {
        let builder = group.new_dataset_builder();
        let builder = match chunk {
            Some(chunk) => builder.chunk(chunk.min(values.len())).deflate(1),
            None => builder.no_chunk(),
        };
        builder.with_data(&values).create(name).unwrap();
    }
    let all = values.iter();
    match kind {
        Kind::Bool => of(group, name, all.map(|&value| value > 0.0).collect(), chunk),
        Kind::I8 => of(group, name, all.map(|&value| value as i8).collect(), chunk),
        Kind::U16 => of(group, name, all.map(|&value| value as u16).collect(), chunk),
        Kind::U32 => of(group, name, all.map(|&value| value as u32).collect(), chunk),
        Kind::I64 => of(group, name, all.map(|&value| value as i64).collect(), chunk),
        Kind::U64 => of(group, name, all.map(|&value| value as u64).collect(), chunk),
        Kind::F64 => of(group, name, values.to_vec(), chunk),
    }
}

fn note(of: &Location, name: &str, text: &str) {
    let text: VarLenUnicode = text.parse().unwrap();
    of.new_attr::<VarLenUnicode>().create(name).unwrap().write_scalar(&text).unwrap();
}

fn events() -> impl Strategy<Value = Vec<CdEvent>> {
    let one = (1..900_u64, 0..640_u16, 0..480_u16, any::<bool>());
    proptest::collection::vec(one, 2..60).prop_map(|rows| {
        let mut t_us = 0;
        let event = |(step, x, y, on)| {
            t_us += step;
            CdEvent { t_us, x, y, on }
        };
        rows.into_iter().map(event).collect()
    })
}

fn columns(events: &[CdEvent], off: f64) -> [Vec<f64>; 4] {
    let of = |value: fn(&CdEvent) -> f64| events.iter().map(value).collect::<Vec<_>>();
    let mut p = of(|event| f64::from(u8::from(event.on)));
    p.iter_mut().filter(|p| **p == 0.0).for_each(|p| *p = off);
    [of(|event| event.t_us as f64), of(|event| event.x.into()), of(|event| event.y.into()), p]
}

fn read(path: &Path) -> Result<Vec<CdEvent>, String> {
    let mut found = Columns::default();
    let read = open(path).and_then(|file| file.decode(None, &mut found)).map_err(|error| error.to_string());
    let anomalies = read?;
    assert!(anomalies.is_empty(), "{anomalies:?}");
    Ok(found.iter().collect())
}

fn later(events: &[CdEvent], by: u64) -> Vec<CdEvent> {
    events.iter().map(|event| CdEvent { t_us: event.t_us + by, ..*event }).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    #[test]
    fn every_way_to_write_the_same_events_gives_them(
        events in events(),
        whole in prop::array::uniform3(prop::sample::select(&WHOLE[..])),
        sign in prop::sample::select(&SIGNS[..]),
        minus: bool,
        chunk in prop::option::of(1..70_usize),
        offset in prop::option::of(prop::sample::select(&WHOLE[..])),
        is_scalar: bool,
        size: bool,
        us: bool,
    ) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.h5");
        let has_minus = minus && [Kind::I8, Kind::I64].contains(&sign);
        {
            let file = File::create(&path).unwrap();
            let group = file.create_group("events").unwrap();
            let kinds = [whole[0], whole[1], whole[2], sign];
            for ((name, values), kind) in ["t", "x", "y", "p"].into_iter().zip(columns(&events, if has_minus { -1.0 } else { 0.0 })).zip(kinds) {
                put(&group, name, kind, &values, chunk);
            }
            match offset {
                Some(Kind::I64) if is_scalar => {
                    file.new_dataset::<i64>().create("t_offset").unwrap().write_scalar(&(OFFSET as i64)).unwrap();
                }
                Some(kind) => put(&file, "t_offset", kind, &[OFFSET as f64], None),
                None => {}
            }
            put(&file, "ms_to_idx", Kind::U64, &[0.0], None);
            if size {
                for (name, side) in [("width", 640), ("height", 480)] {
                    group.new_attr::<u16>().create(name).unwrap().write_scalar(&side).unwrap();
                }
            }
            if us {
                note(&group, "unit", "us");
            }
            note(&file, "recorded by", "somebody");
        }
        let wanted = later(&events, offset.map_or(0, |_| OFFSET));
        prop_assert_eq!(read(&path).unwrap(), wanted);
    }

    #[test]
    fn what_is_not_understood_is_named(events in events(), which in 0..13_usize, at in any::<prop::sample::Index>()) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.h5");
        let [mut t, x, y, mut p] = columns(&events, 0.0);
        let mut kinds = [Kind::I64, Kind::U16, Kind::U16, Kind::I8];
        let mut names = ["t", "x", "y", "p"];
        let mut more = Vec::new();
        let at = at.index(events.len());
        let field = match which {
            0 => { kinds[0] = Kind::F64; t.iter_mut().for_each(|t| *t *= 1e-6); "events/t" }
            1 => { kinds[3] = Kind::F64; "events/p" }
            2 => { t.iter_mut().for_each(|t| *t += 1.7e18); "no clock has" }
            3 => { p[at] = 2.0; "polarity 2" }
            4 => { p[at] = -3.0; "polarity -3" }
            5 => { names[0] = "ts"; "ts" }
            6 => { names[0] = "t_ns"; "t_ns" }
            7 => { names[3] = "pol"; "events/p" }
            8 => { more.push(("t_ms", Kind::U64)); "t_ms" }
            9 => { more.push(("time_unit", Kind::U64)); "time_unit" }
            10 => { t.pop(); "lengths" }
            11 => { more.push(("t_offset", Kind::U64)); "t_offset" }
            _ => "unit",
        };
        {
            let file = File::create(&path).unwrap();
            let group = file.create_group("events").unwrap();
            for ((name, values), kind) in names.into_iter().zip([t, x, y, p]).zip(kinds) {
                put(&group, name, kind, &values, Some(16));
            }
            // An offset within /events is no offset of DSEC's.
            more.into_iter().for_each(|(name, kind)| put(&group, name, kind, &[5.0], None));
            if which == 12 {
                note(&group.dataset("t").unwrap(), "units", "milliseconds");
            }
        }
        let error = read(&path).unwrap_err();
        prop_assert!(error.contains(field) && error.contains("a.h5"), "{which}: {error}");
    }

    #[test]
    fn records_of_metavision_are_read_by_their_names_and_refused_without_one(
        events in events(),
        order in Just([0, 1, 2, 3]).prop_shuffle(),
        lacking in prop::option::of(0..4_usize),
        seconds: bool,
        geometry in prop::sample::select(vec!["640x480", " 640 x 480 ", "640,480", "wide", "", "none"]),
    ) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.h5");
        {
            let file = File::create(&path).unwrap();
            let group = file.create_group("CD").unwrap();
            records(&group, &events, order, lacking, seconds);
            if geometry != "none" {
                note(&file, "geometry", geometry);
            }
        }
        let is_size = ["640x480", " 640 x 480 ", "none"].contains(&geometry);
        match read(&path) {
            Ok(found) => {
                prop_assert!(is_size && lacking.is_none() && !seconds, "{geometry} {lacking:?} {seconds}");
                prop_assert_eq!(found, events);
            }
            Err(error) => {
                let names = ["x", "y", "p", "t"];
                let about = lacking.map(|at| format!("no `{}`", names[at]));
                let is_named = !is_size && error.contains("geometry")
                    || about.is_some_and(|about| error.contains(&about))
                    || seconds && error.contains("`t`");
                prop_assert!(is_named, "{geometry} {lacking:?} {seconds}: {error}");
            }
        }
    }
}

/// A row as it is in memory.
#[derive(Clone, Copy, H5Type)]
#[repr(C)]
struct Record {
    x: u16,
    y: u16,
    p: i16,
    t: i64,
}

/// `CD/events` with fields in this order, one of them called otherwise where it is `lacking`.
fn records(group: &Group, events: &[CdEvent], order: [usize; 4], lacking: Option<usize>, seconds: bool) {
    let kinds = [
        TypeDescriptor::Unsigned(IntSize::U2),
        TypeDescriptor::Unsigned(IntSize::U2),
        TypeDescriptor::Integer(IntSize::U2),
        if seconds { TypeDescriptor::Float(FloatSize::U8) } else { TypeDescriptor::Integer(IntSize::U8) },
    ];
    let sizes = [2, 2, 2, 8];
    let mut at = 0;
    let mut fields = Vec::new();
    for (index, &which) in order.iter().enumerate() {
        let name = if lacking == Some(which) { "other" } else { ["x", "y", "p", "t"][which] };
        fields.push(CompoundField::new(name, kinds[which].clone(), at, index));
        at += sizes[which];
    }
    let kind = TypeDescriptor::Compound(CompoundType { fields, size: at });
    // The library puts fields into the places of their names.
    let rows: Vec<Record> = events
        .iter()
        .map(|event| Record { x: event.x, y: event.y, p: event.on.into(), t: event.t_us as i64 })
        .collect();
    let dataset = group
        .new_dataset_builder()
        .empty_as(&kind)
        .shape(events.len())
        .chunk(events.len().min(16))
        .create("events")
        .unwrap();
    dataset.write(&rows).unwrap();
}

#[test]
fn a_length_that_nothing_stands_behind_is_refused_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.h5");
    {
        let file = File::create(&path).unwrap();
        let group = file.create_group("events").unwrap();
        for name in ["t", "x", "y", "p"] {
            group.new_dataset::<u16>().shape(1_usize << 50).chunk(1 << 16).deflate(1).create(name).unwrap();
        }
    }
    let error = read(&path).unwrap_err();
    assert!(error.contains("events/t says to have 1125899906842624 elements and stores 0"), "{error}");
}
