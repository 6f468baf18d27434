use super::*;

fn some_events() -> Events {
    let mut events = Events::new(640, 360);
    for index in 0..7_u16 {
        let (x, y) = (index * 90, index * 59);
        events.push(crate::Event { t_us: i64::from(index / 2) * 1000 - 5, x, y, on: index % 3 == 0 });
    }
    events
}

/// What is read of an archive with an array of this name beside the others.
pub(super) fn archive_with(name: &str) -> Result<Events, NpzError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npz");
    let arrays = ["t", "x", "y", "p", name].map(|name| (name, npy::encode(&[2], [0_u8, 1].into_iter())));
    write(&path, &arrays).unwrap();
    read_events(&path, None)
}

#[test]
fn events_come_back_with_the_size_of_their_sensor() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("events/a.npz");
    for events in [some_events(), Events::new(3, 2)] {
        write_events(&path, &events).unwrap();
        assert_eq!(read_events(&path, None).unwrap(), events);
        assert_eq!(read_events(&path, Some([events.width, events.height])).unwrap(), events);
    }
    assert!(matches!(read_events(&path, Some([640, 480])), Err(NpzError::Content { .. })));
}

#[test]
fn events_without_a_size_get_the_least_that_holds_them() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npz");
    let columns = |count: u16| {
        let array = |scale: u16| npy::encode(&[count.into()], (0..count).map(move |k| k * scale));
        [("t", array(1)), ("x", array(4)), ("y", array(2)), ("p", array(0))]
    };
    write(&path, &columns(10)).unwrap();
    let events = read_events(&path, None).unwrap();
    assert_eq!((events.width, events.height, events.len()), (37, 19, 10));
    assert!(read_events(&path, Some([36, 19])).is_err(), "an event lies outside");
    write(&path, &columns(0)).unwrap();
    assert!(read_events(&path, None).unwrap_err().to_string().contains("name the size"));
}

#[test]
fn an_archive_that_was_made_to_fill_memory_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bomb.npz");
    let zeros = npy::encode(&[1 << 20], std::iter::repeat_n(0_u8, 1 << 20));
    write(&path, &[("t", zeros.clone()), ("x", zeros)]).unwrap();
    let need = |most: u64| {
        let mut archive = Archive::with_room(open(&path).unwrap(), &path, most)?;
        archive.need(&["t"], "`t`")?;
        archive.need(&["x"], "`x`")
    };
    assert!(need(3 << 20).is_ok());
    let message = need(2 << 20).unwrap_err().to_string();
    assert!(message.contains("unpack to more than") && message.contains("bomb.npz"), "{message}");
}

#[test]
fn writing_twice_gives_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let [a, b] = ["a.npz", "b.npz"].map(|name| folder.path().join(name));
    write_events(&a, &some_events()).unwrap();
    write_events(&b, &some_events()).unwrap();
    assert_eq!(std::fs::read(a).unwrap(), std::fs::read(b).unwrap());
}

#[test]
fn an_archive_cut_short_anywhere_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npz");
    write_events(&path, &some_events()).unwrap();
    let whole = std::fs::read(&path).unwrap();
    for length in 0..whole.len() {
        std::fs::write(&path, &whole[..length]).unwrap();
        assert!(read_events(&path, None).is_err(), "{length} of {} bytes", whole.len());
    }
}

#[test]
fn a_damaged_archive_is_an_error_or_reads_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npz");
    write_events(&path, &some_events()).unwrap();
    let whole = std::fs::read(&path).unwrap();
    for at in 0..whole.len() {
        let mut damaged = whole.clone();
        damaged[at] ^= 0x55;
        std::fs::write(&path, &damaged).unwrap();
        if let Ok(events) = read_events(&path, Some([640, 360])) {
            assert_eq!(events, some_events(), "byte {at}");
        }
    }
}

#[test]
fn events_that_make_no_sense_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npz");
    let message = |events: &Events| {
        write_events(&path, events).unwrap();
        read_events(&path, None).unwrap_err().to_string()
    };
    let mut backwards = some_events();
    backwards.t_us[6] = -100;
    assert!(message(&backwards).contains("times decrease from 1995 to -100"), "{}", message(&backwards));
    let mut outside = some_events();
    outside.y[3] = 360;
    assert!(message(&outside).contains("event 3 lies at (270, 360)"), "{}", message(&outside));

    let column = |name, length| (name, npy::encode(&[length], vec![1_u8; length].into_iter()));
    write(&path, &[column("t", 3), column("x", 3), column("y", 2), column("p", 3)]).unwrap();
    assert!(read_events(&path, Some([9, 9])).unwrap_err().to_string().contains("[3, 3, 2, 3]"));
    write(&path, &[column("t", 3), column("x", 3), column("p", 3)]).unwrap();
    assert!(read_events(&path, Some([9, 9])).unwrap_err().to_string().contains("no array `y`"));
    write(&path, &[column("t", 1), column("x", 1), column("y", 1), ("p", npy::encode(&[1], [2_u8].into_iter()))])
        .unwrap();
    assert!(read_events(&path, Some([9, 9])).unwrap_err().to_string().contains("polarity 2"));
    let signs = ("p", npy::encode(&[2], [0_i64, -1].into_iter()));
    write(&path, &[column("t", 2), column("x", 2), column("y", 2), signs]).unwrap();
    assert!(read_events(&path, Some([9, 9])).unwrap_err().to_string().contains("write OFF in one way"));
}

#[test]
fn luma_sequences_come_back_and_wrong_shapes_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("luma.npz");
    let luma = LumaSequence { frames: 2, width: 3, height: 2, data: (0..12).collect() };
    write(&path, &[("luma", npy::encode(&[2, 2, 3], luma.data.iter().copied()))]).unwrap();
    let read = read_luma(&path).unwrap();
    assert_eq!(read, luma);
    assert_eq!(read.iter().nth(1).unwrap(), [6, 7, 8, 9, 10, 11]);
    write(&path, &[("luma", npy::encode(&[2, 6], luma.data.iter().copied()))]).unwrap();
    assert!(read_luma(&path).unwrap_err().to_string().contains("[2, 6]"));
    write(&path, &[("luma", npy::encode::<u8>(&[4, 0, 6], std::iter::empty()))]).unwrap();
    assert!(read_luma(&path).is_err());
}
