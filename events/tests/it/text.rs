//! Text of events: what the file says is taken, what it does not say is asked for, and what contradicts itself is refused by line.

use std::path::Path;

use erfgs_events::{
    Anomalies, CdEvent, Columns, CsvDecoder, Decoder, EventFile, EventFileError, EventFileHints, SensorSize, TextLayout,
};
use proptest::prelude::*;

/// What a file of this text gives.
fn read(
    folder: &Path,
    name: &str,
    text: &[u8],
) -> Result<(Vec<CdEvent>, Option<SensorSize>, Anomalies), EventFileError> {
    read_as(folder, name, text, None)
}

/// The same, with columns as the user says.
fn read_as(
    folder: &Path,
    name: &str,
    text: &[u8],
    columns: Option<&str>,
) -> Result<(Vec<CdEvent>, Option<SensorSize>, Anomalies), EventFileError> {
    let path = folder.join(name);
    std::fs::write(&path, text).unwrap();
    let columns = columns.map(|columns| columns.parse().unwrap());
    let file = EventFile::open_with(&path, &EventFileHints { columns, size: None })?;
    let mut columns = Columns::default();
    let anomalies = file.decode(&mut columns)?;
    Ok((columns.iter().collect(), file.size, anomalies))
}

/// Events in order of time, whole milliseconds, of which not all times are whole seconds.
fn events() -> impl Strategy<Value = Vec<CdEvent>> {
    let one = (1..400_u64, 0..1280_u16, 0..720_u16, any::<bool>());
    proptest::collection::vec(one, 5..40).prop_map(|rows| {
        let mut t_us = 0;
        let event = |(step, x, y, on)| {
            t_us += step * 1000;
            CdEvent { t_us, x, y, on }
        };
        rows.into_iter().map(event).collect()
    })
}

/// Names of times with the number of microseconds in one.
const TIMES: [(&str, u64); 12] = [
    ("t_us", 1),
    ("Timestamp [us]", 1),
    ("time (µs)", 1),
    ("t_ms", 1000),
    ("\"t_ms\"", 1000),
    ("time_ms", 1000),
    ("milliseconds", 1000),
    ("t_ns", 0),
    ("timestamp_ns", 0),
    ("t_s", 1_000_000),
    ("seconds", 1_000_000),
    ("time [s]", 1_000_000),
];

/// A time in a unit, as C prints it: a whole number has no point.
fn time(t_us: u64, unit: u64) -> String {
    match unit {
        0 => (t_us * 1000).to_string(),
        1 => t_us.to_string(),
        _ => (t_us as f64 / unit as f64).to_string(),
    }
}

fn orders() -> impl Strategy<Value = Vec<usize>> {
    Just(vec![0, 1, 2, 3]).prop_shuffle()
}

fn lines(events: &[CdEvent], order: &[usize], separator: &str, unit: u64) -> String {
    let line = |event: &CdEvent| {
        let fields = [time(event.t_us, unit), event.x.to_string(), event.y.to_string(), u8::from(event.on).to_string()];
        order.iter().map(|&at| fields[at].clone()).collect::<Vec<_>>().join(separator)
    };
    events.iter().map(line).collect::<Vec<_>>().join("\n")
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]

    #[test]
    fn names_tell_order_and_unit_whatever_editor_wrote_them(
        events in events(),
        order in orders(),
        (name, unit) in proptest::sample::select(&TIMES[..]),
        separator in proptest::sample::select(&[",", ";", "\t"][..]),
        mark: bool,
        crlf: bool,
        comment: bool,
        ends: bool,
        indexed: bool,
    ) {
        let names = [name, "x", "Y", "polarity"];
        let header = order.iter().map(|&at| names[at]).collect::<Vec<_>>().join(separator);
        let mut text = lines(&events, &order, separator, unit);
        let mut header = format!("{}{header}", if comment { "# " } else { "" });
        if indexed && !comment {
            header.insert_str(0, separator);
            text = text.lines().enumerate().map(|(n, line)| format!("{n}{separator}{line}\n")).collect();
            text.pop();
        }
        let mut text = format!("{}{header}\n{text}", if mark { "\u{feff}" } else { "" });
        if ends {
            text.push('\n');
        }
        if crlf {
            text = text.replace('\n', "\r\n");
        }
        let folder = tempfile::tempdir().unwrap();
        let (found, _, anomalies) = read(folder.path(), "a.csv", text.as_bytes()).unwrap();
        prop_assert_eq!(&found, &events, "{}", text);
        prop_assert!(anomalies.is_empty());
        // As text of any other ending, and in an archive's place of it.
        let (found, ..) = read(folder.path(), "a.txt", text.as_bytes()).unwrap();
        prop_assert_eq!(&found, &events);
    }

    #[test]
    fn a_name_that_is_not_known_is_refused_with_its_column(
        events in events(),
        order in orders(),
        unknown in "(t_h|t_min|when|stamp|u|v|foo|p_x|t_us_x|polarity_on)",
        at in 0..4_usize,
        mark: bool,
    ) {
        let mut names = order.iter().map(|&at| ["t", "x", "y", "p"][at]).collect::<Vec<_>>();
        names[at] = &unknown;
        let text = format!("{}{}\n{}\n", if mark { "\u{feff}" } else { "" }, names.join(","), lines(&events, &order, ",", 1));
        let folder = tempfile::tempdir().unwrap();
        let error = read(folder.path(), "a.csv", text.as_bytes()).unwrap_err();
        prop_assert!(matches!(error, EventFileError::Line { line: 1, .. }), "{}", error);
        let message = error.to_string();
        prop_assert!(message.contains(&format!("column {} is called `{unknown}`", at + 1)) && message.contains("t_ms"), "{}", message);
        prop_assert!(message.contains("--columns t_us,x,y,p"), "{}", message);
    }

    #[test]
    fn columns_that_the_user_names_are_taken_whatever_the_text_says(
        events in events(),
        order in orders(),
        (name, unit) in proptest::sample::select(&TIMES[7..]),
        header in proptest::option::of("(when,u,v,sign|x,y,t_us,p|a;b|a recording)"),
        others in 0..3_usize,
        ending in proptest::sample::select(&["csv", "txt", "log", "dat"][..]),
    ) {
        let mut names: Vec<&str> = order.iter().map(|&at| [name, "x", "y", "p"][at]).collect();
        let mut text = lines(&events, &order, ",", unit);
        for _ in 0..others {
            // What is none of an event's, and no number.
            text = text.lines().map(|line| format!("cam0,{line}\n")).collect();
            names.insert(0, "-");
        }
        let text = header.iter().chain([&text]).map(String::as_str).collect::<Vec<_>>().join("\n");
        let folder = tempfile::tempdir().unwrap();
        let columns = names.join(",");
        let (found, _, anomalies) = read_as(folder.path(), &format!("a.{ending}"), text.as_bytes(), Some(&columns)).unwrap();
        prop_assert_eq!(found, events, "{}\n{}", columns, text);
        prop_assert!(anomalies.is_empty(), "{}", anomalies);
        // One column more than the text has.
        let error = read_as(folder.path(), "a.csv", text.as_bytes(), Some(&format!("{columns},-"))).unwrap_err();
        prop_assert!(error.to_string().contains("as --columns says"), "{}", error);
    }

    #[test]
    fn polarities_and_times_of_other_programs_are_not_taken_for_damage(
        events in events(),
        [off, on] in prop::sample::select(&[[0, 2], [1, 2], [-1, 2], [0, 255], [3, 4]][..]),
    ) {
        let folder = tempfile::tempdir().unwrap();
        let of = |event: &CdEvent| format!("{},{},{},{}\n", event.t_us, event.x, event.y, if event.on { on } else { off });
        let text: String = events.iter().map(of).collect();
        let others = events.iter().filter(|event| ![0, 1, -1].contains(&if event.on { on } else { off })).count();
        let read_text = |text: &str| read(folder.path(), "a.csv", text.as_bytes());
        match read_text(&text) {
            Err(error) => prop_assert!(error.to_string().contains("line "), "{}", error),
            Ok(_) => prop_assert!(others < 2, "{}", text),
        }
        let early = |event: &CdEvent| format!("{},{},{},1\n", event.t_us as i64 - events[2].t_us as i64, event.x, event.y);
        let text: String = events.iter().map(early).collect();
        let message = read_text(&text).unwrap_err().to_string();
        prop_assert!(message.contains("before zero"), "{}", message);
        // A single one that is damaged is damage.
        let mut lines: Vec<String> = events.iter().map(|event| format!("{},{},{},1\n", event.t_us, event.x, event.y)).collect();
        lines[1] = format!("{},{},{},7\n", events[1].t_us, events[1].x, events[1].y);
        let (found, _, anomalies) = read_text(&lines.concat()).unwrap();
        prop_assert_eq!((found.len(), anomalies.damaged), (events.len() - 1, 1));
    }

    #[test]
    fn a_line_of_units_below_the_names_is_not_left_out(
        events in events(),
        order in orders(),
        (cell, unit) in prop::sample::select(&[("ms", 1000), ("[ms]", 1000), ("(s)", 1_000_000), ("us", 1), ("NS", 0)][..]),
    ) {
        let line = |of: [&str; 4]| order.iter().map(|&at| of[at]).collect::<Vec<_>>().join(",");
        let head = format!("{}\n{}\n", line(["t", "x", "y", "p"]), line([cell, "[px]", "px", "-"]));
        let folder = tempfile::tempdir().unwrap();
        let text = head + &lines(&events, &order, ",", unit);
        let (found, _, anomalies) = read(folder.path(), "a.csv", text.as_bytes()).unwrap();
        prop_assert_eq!(&found, &events, "{}", text);
        prop_assert!(anomalies.is_empty());
    }

    #[test]
    fn times_that_no_clock_has_or_that_vanish_are_refused(events in events()) {
        let folder = tempfile::tempdir().unwrap();
        let with = |name: &str, time: &dyn Fn(u64) -> String| {
            let line = |event: &CdEvent| format!("{},{},{},1\n", time(event.t_us), event.x, event.y);
            let text: String = events.iter().map(line).collect();
            let names = if name.is_empty() { String::new() } else { format!("{name},x,y,p\n") };
            read(folder.path(), "a.csv", format!("{names}{text}").as_bytes()).map_err(|error| error.to_string())
        };
        // Nanoseconds since 1970 are no microseconds, and microseconds no seconds.
        let since_1970 = |t_us: u64| (1_700_000_000_000_000_000 + t_us * 1000).to_string();
        let message = with("", &since_1970).unwrap_err();
        prop_assert!(message.contains("no clock has") && message.contains("--columns"), "{}", message);
        prop_assert!(with("t_ns", &since_1970).is_ok());
        prop_assert!(with("t_s", &|t_us| (1_700_000_000_000_000 + t_us).to_string()).is_err());
        for begin in [0.0, 3.0, 1_305_031_102.25] {
            let message = with("t_us", &|t_us| format!("{:.7}", begin + t_us as f64 * 1e-8)).unwrap_err();
            prop_assert!(message.contains("within a microsecond"), "{}", message);
        }
    }

    #[test]
    fn a_column_that_stands_still_is_not_the_time(events in events(), x in 0..900_u16) {
        let line = |event: &CdEvent| format!("{x},{},{},{}\n", event.y, event.t_us / 1000, u8::from(event.on));
        let text: String = events.iter().map(line).collect();
        let folder = tempfile::tempdir().unwrap();
        let message = read(folder.path(), "a.csv", text.as_bytes()).unwrap_err().to_string();
        prop_assert!(message.contains("they look like x,y,t,p"), "{}", message);
        // Events of one instant are what they are, unless they lie row by row, as times would.
        let mut events = events;
        (events[0].y, events[1].y) = (700, 3);
        let text: String = events.iter().map(|event| format!("700,{},{},1\n", event.x, event.y)).collect();
        prop_assert!(read(folder.path(), "a.csv", text.as_bytes()).is_ok(), "{}", text);
    }

    #[test]
    fn a_unit_in_a_comment_is_not_left_out(
        events in events(),
        comment in "(timestamps are in ms|time unit: milliseconds|t \\[ns\\], pixel, sign|Time in seconds)",
    ) {
        let text = format!("# {comment}\n{}\n", lines(&events, &[0, 1, 2, 3], " ", 1));
        let folder = tempfile::tempdir().unwrap();
        let error = read(folder.path(), "a.txt", text.as_bytes()).unwrap_err().to_string();
        prop_assert!(error.contains("line 1 of") && error.contains("--columns t_ms"), "{}", error);
        let (found, ..) = read_as(folder.path(), "a.txt", text.as_bytes(), Some("t_us,x,y,p")).unwrap();
        prop_assert_eq!(&found, &events);
        // What a comment says and the times show is one.
        for comment in ["times in us", "recorded at a time of day", "x and y in pixels, 5 ms of exposure"] {
            let text = format!("# {comment}\n{}\n", lines(&events, &[0, 1, 2, 3], " ", 1));
            let (found, ..) = read(folder.path(), "a.txt", text.as_bytes()).unwrap();
            prop_assert_eq!(&found, &events);
        }
    }

    #[test]
    fn the_file_decides_whether_times_are_seconds(events in events(), whole in 1..5_u64) {
        // Some times are whole seconds, which are printed without a point.
        let mut events = events;
        let last_us = events.last().unwrap().t_us.div_ceil(1_000_000) * 1_000_000;
        for n in 0..whole {
            events.push(CdEvent { t_us: last_us + n * 1_000_000, x: 1, y: 2, on: true });
        }
        events[0].t_us = 1;
        let text = lines(&events, &[0, 1, 2, 3], " ", 1_000_000);
        let folder = tempfile::tempdir().unwrap();
        let (found, _, anomalies) = read(folder.path(), "events.txt", text.as_bytes()).unwrap();
        prop_assert_eq!(found, events, "{}", text);
        prop_assert!(anomalies.is_empty());
    }

    #[test]
    fn microseconds_among_seconds_are_refused_by_their_line(at in 2..60_usize, seconds_first: bool) {
        let line = |n: usize| {
            let t_us = 900_000_000_000 + n * 333;
            if (n < at) == seconds_first { format!("{:.6} 3 4 1\n", t_us as f64 * 1e-6) } else { format!("{t_us} 3 4 1\n") }
        };
        let text: String = (1..80).map(line).collect();
        let folder = tempfile::tempdir().unwrap();
        let error = read(folder.path(), "events.txt", text.as_bytes()).unwrap_err();
        let EventFileError::Line { line, .. } = error else { panic!("{error}") };
        prop_assert_eq!(line as usize, at, "{}", error);
    }

    #[test]
    fn columns_in_another_order_are_never_taken_for_t_x_y_p(events in events(), geometry: bool) {
        let text = lines(&events, &[1, 2, 3, 0], ",", 1);
        let folder = tempfile::tempdir().unwrap();
        if geometry {
            let text = format!("%geometry:1280,720\n{text}\n");
            let (found, size, _) = read(folder.path(), "a.csv", text.as_bytes()).unwrap();
            prop_assert_eq!((found, size), (events, Some(SensorSize { width: 1280, height: 720 })));
        } else {
            let message = read(folder.path(), "a.csv", text.as_bytes()).unwrap_err().to_string();
            prop_assert!(message.contains("put a line `x,y,p,t` before"), "{}", message);
        }
    }

    #[test]
    fn one_column_that_goes_back_or_is_too_large_tells_the_order_where_another_fits(mut events in events(), late: bool) {
        // Row by row: what is taken for times goes back once, or never, and what is taken for pixels is too large at the end.
        events.sort_by_key(|event| event.x);
        for (at, event) in events.iter_mut().enumerate() {
            event.t_us = 1000 * at as u64 + 1;
        }
        let last = events.last_mut().unwrap();
        match late {
            true => last.t_us = 1_000_000,
            false => last.x = 0,
        }
        events[0].x = 1;
        (events[1].y, events[2].y) = (700, 3);
        let folder = tempfile::tempdir().unwrap();
        let text = lines(&events, &[1, 2, 0, 3], " ", 1);
        let message = read(folder.path(), "a.txt", text.as_bytes()).unwrap_err().to_string();
        prop_assert!(message.contains("put a line `x,y,t,p` before"), "{}", message);
        let (found, ..) = read_as(folder.path(), "a.txt", text.as_bytes(), Some("x,y,t,p")).unwrap();
        prop_assert_eq!(found, events);
    }

    #[test]
    fn a_layout_and_its_decoder_take_any_bytes(bytes: Vec<u8>, text in "[0-9txyp_,;# \n%.e-]{0,200}") {
        let folder = tempfile::tempdir().unwrap();
        for bytes in [bytes, text.into_bytes()] {
            let _ = read(folder.path(), "a.csv", &bytes);
            let _ = read(folder.path(), "a.txt", &bytes);
        }
    }
}

#[test]
fn what_text_leaves_open_is_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |text: &[u8]| read(folder.path(), "a.csv", text).unwrap_err().to_string();
    for (text, words) in [
        (&b"1.0 2 3 1\n2.0 3 4 0\n"[..], &["line 1", "seconds or microseconds", "t_us,x,y,p"][..]),
        (b"\xff\xfet\0,\0x\0", &["UTF-16", "iconv"]),
        (b"1,2,3,0,9\n2,2,3,0,9\n", &["line 1", "5 columns"]),
        (b"# a note\n1,2,3,7\n2,2,3,9\n", &["line 2", "column 4 is `7`", "x,y,p,t_us"]),
        (b"t,x,y,y\n1,2,3,4\n", &["line 1", "two columns are called y"]),
        (b"t,x,p\n1,2,1\n", &["line 1", "lacks y"]),
        (b"%geometry:wide\n1,2,1,5\n", &["line 1", "no size of a sensor"]),
        (b"1,2,3,0\n2,2,3,-1\n", &["line 2", "0 in some lines and -1"]),
        (b"10,2,3,0\n11.5,2,3,1\n11,2,3,0\n12,1,1,1\n20000000000,1,1,1\n", &["line 5", "not both are seconds"]),
    ] {
        let message = refused(text);
        assert!(words.iter().all(|word| message.contains(word)), "{message}");
    }
    // The first 64 KiB say microseconds, and what follows something else.
    let mut long: String = (0..9000).map(|n| format!("{n},2,3,1\n")).collect();
    assert!(long.len() > 80_000);
    long += "9000.5,2,3,1\n";
    let message = refused(long.as_bytes());
    assert!(message.contains("line 9001 of") && message.contains("t_ms"), "{message}");
}

#[test]
fn a_text_is_read_alike_with_its_layout_and_without() {
    let text = b"x,y,p,t_ms\n3,4,1,10\n5,6,0,11\n";
    let mut columns = Columns::default();
    let mut decoder = CsvDecoder::new(None);
    decoder.decode(text, &mut columns);
    decoder.finish(&mut columns);
    assert_eq!((columns.t_us.as_slice(), columns.x.as_slice()), (&[10_000, 11_000][..], &[3, 5][..]));
    assert_eq!(decoder.contradiction(), None);
    let mut plain = CsvDecoder::of(TextLayout::default(), None);
    plain.decode(b"7,1,2,1\n0.5,1,2,1\n", &mut columns);
    assert!(plain.contradiction().is_some_and(|(line, what)| line == 2 && what.contains("0.5")));
}

#[test]
fn words_below_a_line_of_names_are_a_damaged_line() {
    let folder = tempfile::tempdir().unwrap();
    let (events, _, anomalies) =
        read(folder.path(), "none.csv", b"t,x,y,on\nthis,is,no,event\nnor,is,this,one\n").unwrap();
    assert!(events.is_empty());
    assert_eq!(anomalies.damaged, 2);
    let (events, ..) = read(folder.path(), "some.csv", b"t,x,y,on\nthis,is,no,event\n7,1,2,0\n").unwrap();
    assert_eq!(events.len(), 1);
}

#[test]
fn names_in_latin_1_tell_the_unit() {
    let folder = tempfile::tempdir().unwrap();
    let (events, ..) = read(folder.path(), "a.csv", b"time [\xb5s],x,y,p\n1000,1,2,1\n2000,1,2,0\n").unwrap();
    assert_eq!(events[1].t_us, 2000);
    // What is no letter of a unit is none.
    for head in [&b"time [\xe6s],x,y,p\n"[..], b"time [\x83\xcas],x,y,p\n"] {
        let message = read(folder.path(), "a.csv", &[head, b"1000,1,2,1\n"].concat()).unwrap_err().to_string();
        assert!(message.contains("column 1 is called"), "{message}");
    }
}

#[test]
fn columns_are_for_text_and_say_all_of_an_event() {
    let folder = tempfile::tempdir().unwrap();
    let raw = b"% evt 3.0\n% format EVT3;height=720;width=1280\n% end\n\x64\x60\x00\x80";
    let error = read_as(folder.path(), "a.raw", raw, Some("t,x,y,p")).unwrap_err().to_string();
    assert!(error.contains("is evt3 and no text"), "{error}");
    for (columns, words) in [
        ("t,x,y", "lacks p"),
        ("t,x,y,p,p", "two columns are called p"),
        ("t,x,y,sign", "column 4 is called `sign`"),
        ("", "lacks t, x, y, p"),
        (&"-,".repeat(40), "41 columns"),
    ] {
        let message = columns.parse::<erfgs_events::TextColumns>().unwrap_err();
        assert!(message.contains(words) && message.contains("x,y,p,t_us"), "{message}");
    }
}
