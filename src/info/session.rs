//! What a session holds, for `erfgs info`.

use std::{collections::BTreeMap, path::Path};

use erfgs_base::calendar::DateTime;
use erfgs_events::{Anomalies, Digests};
use erfgs_recorder::RigConfig;
use erfgs_session::{
    clock::{ClockFit, Residuals},
    container::{FileSummary, IncidentEntry, Session, Status, Stream, Summary},
    source::{Description, Incident},
};
use erfgs_sync::Synchronisation;
use serde::Serialize;

use super::settings;
use crate::{
    sync,
    terminal::{Terminal, bytes, table, thousands},
};

#[derive(Serialize)]
struct SessionSummary<'a> {
    kind: &'static str,
    file: &'a Path,
    bytes: u64,
    complete: bool,
    whole_bytes: u64,
    /// The files of a session in parts.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    files: Vec<FileOf<'a>>,
    /// Of a part that is read by itself: its number.
    #[serde(skip_serializing_if = "Option::is_none")]
    part: Option<u32>,
    chunks: usize,
    recorded_with: &'a str,
    machine: &'a BTreeMap<String, String>,
    epoch_ns: i64,
    /// The rig's name in its configuration.
    rig_name: Option<String>,
    /// Whether everything was read and all checksums were verified.
    checked: bool,
    span_seconds: f64,
    streams: Vec<StreamSummary<'a>>,
    incidents: &'a [IncidentEntry],
    incident_count: u64,
    clocks: &'a BTreeMap<String, ClockFit>,
    last_status: &'a Option<Status>,
    damage: Vec<String>,
    /// `S.sync.json` beside the session, if there is one.
    sync: Option<&'a Synchronisation>,
    unknown_encodings: &'a [String],
    rig: &'a Option<String>,
    /// Host time of the session's zero.
    #[serde(skip)]
    start_ns: Option<i64>,
}

#[derive(Serialize)]
struct StreamSummary<'a> {
    #[serde(flatten)]
    description: &'a erfgs_session::source::Description,
    packets: u64,
    bytes: u64,
    /// Packets that the sequence numbers show as missing.
    missing: u64,
    discontinuities: u64,
    damaged: u64,
    first_seconds: Option<f64>,
    last_seconds: Option<f64>,
    packets_per_second: f64,
    /// What decoding the stream gives; only if it was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    decoded: Option<DecodedSummary>,
}

/// A file of a session in parts.
#[derive(Serialize)]
struct FileOf<'a> {
    file: &'a Path,
    bytes: u64,
    whole_bytes: u64,
    complete: bool,
}

#[derive(Serialize)]
struct DecodedSummary {
    events: u64,
    edges: u64,
    range_us: Option<(u64, u64)>,
    anomalies: Anomalies,
    /// SHA3-224 of each field, hexadecimal.
    sha3_224_of_field: BTreeMap<&'static str, String>,
}

/// Describes a session; decodes its events where their digests are wanted, and reads all of it where it is to be checked.
pub fn run(path: &Path, digest: bool, check: bool, terminal: &Terminal) -> anyhow::Result<()> {
    let mut session = Session::open(path)?;
    let checked = check || session.was_read_through();
    let mut damage = session.summary().damage.clone();
    if check {
        let total = session.summary().streams.iter().map(|stream| stream.totals.bytes).sum();
        let progress = terminal.progress("checking");
        for place in session.check(|bytes| progress.update(bytes, total, "bytes"))? {
            if !damage.contains(&place) {
                damage.push(place);
            }
        }
    }
    let mut decoded = Vec::new();
    for stream in 0..session.summary().streams.len() {
        decoded.push(if digest { decode(&mut session, stream, &mut damage, terminal)? } else { None });
    }
    let summary = session.summary();
    let sync = sync::kept(path, summary, terminal).unwrap_or_else(|error| {
        terminal.note(format!("clocks by `erfgs sync` are left out: {error}"));
        None
    });
    let places = damage.len();
    let mut described = SessionSummary { checked, damage, sync: sync.as_ref(), ..describe(path, summary) };
    for (stream, decoded) in std::iter::zip(&mut described.streams, decoded) {
        stream.decoded = decoded;
    }
    terminal.result(&described, || text(&described))?;
    if places > 0 && (check || digest) {
        anyhow::bail!("{} is damaged in {places} places; `erfgs recover` saves the intact part", path.display());
    }
    Ok(())
}

fn decode(
    session: &mut Session,
    stream: usize,
    damage: &mut Vec<String>,
    terminal: &Terminal,
) -> anyhow::Result<Option<DecodedSummary>> {
    let recorded = &session.summary().streams[stream];
    let (id, total) = (recorded.description.id.clone(), recorded.totals.bytes);
    let progress = terminal.progress(&id);
    let mut digests = Digests::new();
    let decoded = session.decode_events(stream, None, &mut digests, |bytes| progress.update(bytes, total, "bytes"))?;
    for place in decoded.iter().flat_map(|decoded| &decoded.damage) {
        if !damage.contains(place) {
            damage.push(place.clone());
        }
    }
    Ok(decoded.map(|decoded| DecodedSummary {
        events: digests.events,
        edges: digests.edges,
        range_us: digests.range_us,
        anomalies: decoded.anomalies,
        sha3_224_of_field: digests.finish().into_iter().collect(),
    }))
}

fn describe<'a>(path: &'a Path, summary: &'a Summary) -> SessionSummary<'a> {
    SessionSummary {
        kind: if summary.is_session { "session" } else { "ros2-recording" },
        file: path,
        bytes: summary.file_bytes,
        complete: summary.complete,
        whole_bytes: summary.whole_bytes,
        files: summary.files.iter().map(describe_file).collect(),
        part: summary.part.as_ref().map(|part| part.number).filter(|&number| number > 0),
        chunks: summary.chunks,
        recorded_with: &summary.start.program,
        machine: &summary.start.machine,
        epoch_ns: summary.start.epoch_ns,
        rig_name: summary.rig.as_ref().and_then(|rig| Some(RigConfig::parse(rig, path).ok()?.name)),
        checked: false,
        span_seconds: summary.span_ns().map_or(0.0, |[first, last]| last.saturating_sub(first) as f64 * 1e-9),
        streams: summary.streams.iter().map(|stream| describe_stream(summary, stream)).collect(),
        incidents: &summary.totals.incidents,
        incident_count: summary.totals.incident_count,
        clocks: &summary.totals.clocks,
        last_status: &summary.totals.status,
        damage: Vec::new(),
        sync: None,
        unknown_encodings: &summary.unknown_encodings,
        rig: &summary.rig,
        start_ns: Some(summary.start.host_ns),
    }
}

fn describe_file(file: &FileSummary) -> FileOf<'_> {
    let FileSummary { path, bytes, whole_bytes, complete } = file;
    FileOf { file: path, bytes: *bytes, whole_bytes: *whole_bytes, complete: *complete }
}

fn describe_stream<'a>(summary: &Summary, stream: &'a Stream) -> StreamSummary<'a> {
    let totals = &stream.totals;
    let seconds = |host_ns: Option<i64>| host_ns.map(|host_ns| summary.start.session_ns(host_ns) as f64 * 1e-9);
    StreamSummary {
        description: &stream.description,
        packets: totals.packets,
        bytes: totals.bytes,
        missing: totals.missing,
        discontinuities: totals.discontinuities,
        damaged: totals.damaged,
        first_seconds: seconds(totals.first_host_ns),
        last_seconds: seconds(totals.last_host_ns),
        packets_per_second: totals.rate_hz().unwrap_or_default(),
        decoded: None,
    }
}

/// `2025-06-15 15:06:40 UTC, 2.600 s, with erfgs 0.1.0`.
fn recorded(session: &SessionSummary<'_>) -> String {
    // What no clock told is not the year 1970.
    let when =
        if session.epoch_ns > 0 { format!("{} UTC, ", DateTime::of_ns(session.epoch_ns)) } else { String::new() };
    format!("{when}{:.3} s, with {}", session.span_seconds, session.recorded_with)
}

/// What is known of a stream besides its counts: settings as read back, the last readings, its clock.
fn details(session: &SessionSummary<'_>, description: &Description) -> String {
    let id = &description.id;
    let residuals = |residuals: Residuals, samples: u64| {
        let us = |ns: f64| ns / 1e3;
        format!(
            "residual p50 {:.1} µs, p95 {:.1} µs, max {:.1} µs over {} samples",
            us(residuals.p50_ns),
            us(residuals.p95_ns),
            us(residuals.max_ns),
            thousands(samples)
        )
    };
    let mut rows = settings::rows(&description.settings);
    if let Some(stream) = session.last_status.as_ref().and_then(|status| status.streams.get(id)) {
        let reading = |(name, value): (&String, &Option<f64>)| Some(format!("{name} {:.3}", (*value)?));
        let readings: Vec<String> = stream.readings.iter().filter_map(reading).collect();
        if !readings.is_empty() {
            rows.push(["readings at the end".to_owned(), readings.join(", ")]);
        }
    }
    if let Some(fit) = session.clocks.get(id) {
        rows.push(["clock while recording".to_owned(), residuals(fit.residuals, fit.samples)]);
    }
    if let Some(sync) = session.sync.and_then(|sync| sync.stream(id)) {
        for row in sync.rows() {
            // A part of the stream that begins after a break says when.
            let part = row.name.strip_prefix(id.as_str()).unwrap_or_default();
            let fitted =
                if row.samples > 0 { format!("; {}", residuals(row.residuals, row.samples)) } else { String::new() };
            rows.push([format!("clock by `erfgs sync`{part}"), format!("tier {}{fitted}", row.tier.name())]);
        }
    }
    if rows.is_empty() {
        return String::new();
    }
    let rows: Vec<Vec<String>> = rows.into_iter().map(|[key, value]| vec![format!("  {key}"), value]).collect();
    format!("\n{id}\n{}", table(&rows))
}

fn text(session: &SessionSummary<'_>) -> String {
    let file = session.file.display();
    let mut rows = vec![
        vec![
            "session".to_owned(),
            format!("{file}, {}, {} chunks", bytes(session.bytes), thousands(session.chunks as u64)),
        ],
        vec!["recorded".to_owned(), recorded(session)],
    ];
    if let Some(name) = &session.rig_name {
        rows.push(vec!["rig".to_owned(), name.clone()]);
    }
    let machine: Vec<String> = session.machine.iter().map(|(key, value)| format!("{key} {value}")).collect();
    if !machine.is_empty() {
        rows.push(vec!["machine".to_owned(), machine.join(", ")]);
    }
    if let Some(number) = session.part {
        let alone = format!("number {number} of a session, read by itself; the first file gives all of them");
        rows.push(vec!["part".to_owned(), alone]);
    }
    for part in session.files.iter().filter(|_| session.files.len() > 1) {
        let size = match (part.complete, part.whole_bytes) {
            (true, _) => bytes(part.bytes),
            (false, 0) if part.bytes == 0 => "MISSING or empty".to_owned(),
            (false, 0) => format!("{}: cut off before its first packet", bytes(part.bytes)),
            (false, whole) => format!("{}: was not ended, intact up to byte {whole}", bytes(part.bytes)),
        };
        rows.push(vec!["file".to_owned(), format!("{}, {size}", part.file.display())]);
    }
    if !session.complete {
        let whole = if session.files.len() > 1 {
            format!("was not ended; `erfgs recover {file} --in-place` repairs its files")
        } else {
            format!("was not ended: intact up to byte {}; `erfgs recover {file}` repairs it", session.whole_bytes)
        };
        rows.push(vec!["recording".to_owned(), whole]);
    }
    let contents = match (session.checked, session.damage.len()) {
        (true, 0) => "read through: nothing is damaged".to_owned(),
        (true, places) => format!("read through: DAMAGED in {places} places, see below"),
        (false, _) => format!("not checked; `erfgs info {file} --check` reads everything and verifies the checksums"),
    };
    rows.push(vec!["contents".to_owned(), contents]);
    let mut text = table(&rows);
    let heading = ["stream", "device", "encoding", "size", "packets", "per s", "bytes", "missing", "cuts", "damaged"];
    let mut rows = vec![heading.map(str::to_owned).to_vec()];
    for stream in &session.streams {
        let description = stream.description;
        let device = match description.serial.as_str() {
            "" => description.model.clone(),
            serial => format!("{} {serial}", description.model),
        };
        let size =
            if description.width == 0 { "-".into() } else { format!("{}x{}", description.width, description.height) };
        rows.push(vec![
            description.id.clone(),
            device,
            description.encoding.name().to_owned(),
            size,
            thousands(stream.packets),
            format!("{:.1}", stream.packets_per_second),
            thousands(stream.bytes),
            thousands(stream.missing),
            thousands(stream.discontinuities),
            thousands(stream.damaged),
        ]);
    }
    text.push('\n');
    text.push_str(&table(&rows));
    for stream in &session.streams {
        let Some(decoded) = &stream.decoded else { continue };
        let id = &stream.description.id;
        text.push_str(&format!("{id}: {} events, {} edges\n", thousands(decoded.events), thousands(decoded.edges)));
        for (field, digest) in &decoded.sha3_224_of_field {
            text.push_str(&format!("{id}: {field} {digest}\n"));
        }
    }
    for stream in &session.streams {
        text.push_str(&details(session, stream.description));
    }
    if let Some(status) = session.last_status {
        for (id, stream) in &status.streams {
            let dropped: Vec<String> =
                stream.dropped.iter().map(|(stage, count)| format!("{count} in {stage}")).collect();
            let counters = &stream.counters;
            if counters.lost + counters.refused > 0 || stream.dropped.values().any(|&count| count > 0) {
                let by_stage =
                    if dropped.is_empty() { String::new() } else { format!("; dropped {}", dropped.join(", ")) };
                text.push_str(&format!(
                    "{id}: {} lost before they reached the host, {} refused{by_stage}\n",
                    counters.lost, counters.refused
                ));
            }
        }
    }
    for entry in session.incidents.iter().take(20) {
        let what = match &entry.incident {
            Incident::Lost { reason } => format!("lost: {reason}"),
            Incident::Back => "back".to_owned(),
            Incident::Warning { message } => format!("warning: {message}"),
            Incident::Adjusted { changed } => {
                let at_s =
                    session.start_ns.map_or(0.0, |start_ns| entry.host_ns.saturating_sub(start_ns) as f64 * 1e-9);
                format!("changed at {at_s:.3} s: {}", serde_json::Value::Object(changed.clone()))
            }
            Incident::Ended { reason } => format!("the recording ended: {reason}"),
        };
        let stream = if entry.stream.is_empty() { "recorder" } else { &entry.stream };
        text.push_str(&format!("{stream}: {what}\n"));
    }
    if session.incident_count > 20 {
        text.push_str(&format!("and {} incidents more; --json lists them\n", session.incident_count - 20));
    }
    for damage in &session.damage {
        text.push_str(&format!("damaged: {damage}\n"));
    }
    for encoding in session.unknown_encodings {
        text.push_str(&format!("erfgs does not decode events that are encoded as '{encoding}'\n"));
    }
    text
}
