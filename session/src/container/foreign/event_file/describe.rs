//! What an event file says of itself, as a session says it.

use std::path::Path;

use serde_json::{Map, Value};

use super::{source::EventSource, survey::Survey};
use crate::{
    container::{
        Stream, Summary,
        record::{SessionStart, StreamTotals, topic},
    },
    source::Description,
};
use erfgs_base::calendar::DateTime;
use erfgs_events::EventFormat;

/// Times from here on, September 2001, are taken for microseconds since 1970, as those of AEDAT 4 are.
const SINCE_1970_US: u64 = 1_000_000_000_000_000;

/// The summary of a session that holds the file.
pub(super) fn summary(path: &Path, source: &EventSource, survey: &Survey, of_addresses: bool) -> Summary {
    let description = description(path, source, of_addresses);
    let file_bytes = std::fs::metadata(path).map_or(0, |metadata| metadata.len());
    let bytes = match source {
        EventSource::Stream(file) => file_bytes.saturating_sub(file.body),
        _ => file_bytes,
    };
    let totals = StreamTotals {
        bytes,
        first_host_ns: survey.last_ns.map(|_| 0),
        last_host_ns: survey.last_ns,
        ..StreamTotals::default()
    };
    let topic = topic(&description.id, description.encoding);
    let start = SessionStart {
        host_ns: 0,
        epoch_ns: recorded_ns(source, survey.first_us).unwrap_or(0),
        program: format!("another program, as {}", source.name()),
        ..SessionStart::default()
    };
    Summary {
        start,
        streams: vec![Stream { description, topic, totals }],
        complete: true,
        file_bytes,
        whole_bytes: file_bytes,
        ..Summary::default()
    }
}

fn description(path: &Path, source: &EventSource, of_addresses: bool) -> Description {
    let header = |key: &str| header(source, key).unwrap_or_default();
    let (mut model, mut serial) = (String::new(), header("serial_number"));
    if let EventSource::Stream(file) = source {
        match file.format {
            EventFormat::Raw(_) | EventFormat::Dat(_) if !header("sensor_name").is_empty() => {
                model = format!("Prophesee {}", header("sensor_name"));
            }
            // "events DAVIS346_00000002": model and serial number of the camera.
            EventFormat::Aedat4 => {
                let camera = file.header.iter().find_map(|(_, value)| value.split_once(' ')?.1.rsplit_once('_'));
                if let Some((of_model, of_serial)) = camera {
                    (model, serial) = (of_model.to_owned(), of_serial.to_owned());
                }
            }
            _ => {}
        }
    }
    if model.is_empty() {
        model = format!("{} file", source.name());
    }
    let mut settings = Map::new();
    let mut set = |key: &str, value: Value| drop(settings.insert(key.to_owned(), value));
    set("file", path.file_name().unwrap_or_default().to_string_lossy().into());
    set("file_format", source.name().into());
    if !header("firmware_version").is_empty() {
        set("firmware", header("firmware_version").into());
    }
    if of_addresses {
        set("size_from", "addresses of events".into());
    }
    let size = source.size();
    Description {
        id: id(path),
        model,
        serial,
        encoding: source.encoding().into(),
        width: size.map_or(0, |size| size.width.into()),
        height: size.map_or(0, |size| size.height.into()),
        start_order: 0,
        settings,
    }
}

/// The stream's name: that of the file, as far as topics can have it.
fn id(path: &Path) -> String {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let name: String =
        stem.chars().map(|letter| if letter.is_ascii_alphanumeric() || letter == '_' { letter } else { '-' }).collect();
    if name.chars().any(|letter| letter.is_ascii_alphanumeric()) { name } else { "events".to_owned() }
}

fn header(source: &EventSource, key: &str) -> Option<String> {
    let EventSource::Stream(file) = source else { return None };
    let field = file.header.iter().rev().find(|(name, _)| name.eq_ignore_ascii_case(key));
    field.map(|(_, value)| value.clone())
}

/// Time since 1970 of the first item, nanoseconds: from the file's times, or from the date in its header.
fn recorded_ns(source: &EventSource, first_us: u64) -> Option<i64> {
    if first_us >= SINCE_1970_US {
        return i64::try_from(first_us).ok()?.checked_mul(1000);
    }
    date_ns(&header(source, "date")?)
}

/// Nanoseconds since 1970 of `YYYY-MM-DD hh:mm:ss`, for years that 64 bits of them hold.
fn date_ns(text: &str) -> Option<i64> {
    let date = DateTime::parse(text).filter(|date| (1970..=2261).contains(&date.year))?;
    date.seconds()?.checked_mul(1_000_000_000)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_are_those_that_64_bits_of_nanoseconds_hold() {
        assert_eq!(date_ns("2025-06-15 15:06:40"), Some(1_750_000_000_000_000_000));
        assert_eq!(date_ns("1970-01-01 00:00:00"), Some(0));
        for wrong in [
            "",
            "yesterday",
            "2025-13-01 00:00:00",
            "2025-06-15",
            "99999999999999999999-01-01 0:0:0",
            "1969-12-31 23:59:59",
            "2262-01-01 00:00:00",
        ] {
            assert_eq!(date_ns(wrong), None, "{wrong}");
        }
    }

    #[test]
    fn a_streams_name_is_one_that_topics_can_have() {
        assert_eq!(["a/evt 3.raw", "x/.raw", "é.dat"].map(|path| id(Path::new(path))), ["evt-3", "-raw", "events"]);
    }
}
