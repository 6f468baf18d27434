//! What a session holds, for `erfgs info`.

use std::{collections::BTreeMap, path::Path};

use erfgs_session::{
    clock::ClockFit,
    codec::{Anomalies, Digests},
    container::{IncidentEntry, Session, Status, Stream, Summary},
    source::Incident,
};
use serde::Serialize;

use crate::terminal::{Terminal, bytes, table, thousands};

#[derive(Serialize)]
struct SessionSummary<'a> {
    kind: &'static str,
    file: &'a Path,
    bytes: u64,
    complete: bool,
    whole_bytes: u64,
    chunks: usize,
    recorded_with: &'a str,
    machine: &'a BTreeMap<String, String>,
    epoch_ns: i64,
    span_seconds: f64,
    streams: Vec<StreamSummary<'a>>,
    incidents: &'a [IncidentEntry],
    incident_count: u64,
    clocks: &'a BTreeMap<String, ClockFit>,
    last_status: &'a Option<Status>,
    damage: &'a [String],
    unknown_encodings: &'a [String],
    rig: &'a Option<String>,
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

#[derive(Serialize)]
struct DecodedSummary {
    events: u64,
    edges: u64,
    range_us: Option<(u64, u64)>,
    anomalies: Anomalies,
    /// SHA3-224 of each field, hexadecimal.
    sha3_224_of_field: BTreeMap<&'static str, String>,
}

/// Describes a session; decodes its events where their digests are wanted.
pub fn run(path: &Path, digest: bool, terminal: &Terminal) -> anyhow::Result<()> {
    let mut session = Session::open(path)?;
    let mut decoded = Vec::new();
    for stream in 0..session.summary().streams.len() {
        decoded.push(if digest { decode(&mut session, stream, terminal)? } else { None });
    }
    let summary = session.summary();
    let mut described = describe(path, summary);
    for (stream, decoded) in std::iter::zip(&mut described.streams, decoded) {
        stream.decoded = decoded;
    }
    terminal.result(&described, || text(&described))
}

fn decode(session: &mut Session, stream: usize, terminal: &Terminal) -> anyhow::Result<Option<DecodedSummary>> {
    let recorded = &session.summary().streams[stream];
    let (id, total) = (recorded.description.id.clone(), recorded.totals.bytes);
    let progress = terminal.progress(&id);
    let mut digests = Digests::new();
    let decoded = session.decode_events(stream, None, &mut digests, |bytes| progress.update(bytes, total, "bytes"))?;
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
        chunks: summary.chunks,
        recorded_with: &summary.start.program,
        machine: &summary.start.machine,
        epoch_ns: summary.start.epoch_ns,
        span_seconds: summary.span_ns().map_or(0.0, |[first, last]| last.saturating_sub(first) as f64 * 1e-9),
        streams: summary.streams.iter().map(|stream| describe_stream(summary, stream)).collect(),
        incidents: &summary.totals.incidents,
        incident_count: summary.totals.incident_count,
        clocks: &summary.totals.clocks,
        last_status: &summary.totals.status,
        damage: &summary.damage,
        unknown_encodings: &summary.unknown_encodings,
        rig: &summary.rig,
    }
}

fn describe_stream<'a>(summary: &Summary, stream: &'a Stream) -> StreamSummary<'a> {
    let totals = &stream.totals;
    let seconds = |host_ns: Option<i64>| host_ns.map(|host_ns| summary.start.session_ns(host_ns) as f64 * 1e-9);
    let (first, last) = (seconds(totals.first_host_ns), seconds(totals.last_host_ns));
    let rate = match (first, last) {
        (Some(first), Some(last)) if last > first => totals.packets.saturating_sub(1) as f64 / (last - first),
        _ => 0.0,
    };
    StreamSummary {
        description: &stream.description,
        packets: totals.packets,
        bytes: totals.bytes,
        missing: totals.missing,
        discontinuities: totals.discontinuities,
        damaged: totals.damaged,
        first_seconds: first,
        last_seconds: last,
        packets_per_second: rate,
        decoded: None,
    }
}

fn text(session: &SessionSummary<'_>) -> String {
    let file = session.file.display();
    let mut rows = vec![
        vec![
            "session".to_owned(),
            format!("{file}, {}, {} chunks", bytes(session.bytes), thousands(session.chunks as u64)),
        ],
        vec!["recorded".to_owned(), format!("{:.3} s with {}", session.span_seconds, session.recorded_with)],
    ];
    let machine: Vec<String> = session.machine.iter().map(|(key, value)| format!("{key} {value}")).collect();
    if !machine.is_empty() {
        rows.push(vec!["machine".to_owned(), machine.join(", ")]);
    }
    if !session.complete {
        let whole = format!("was not ended: whole up to byte {}; `erfgs recover {file}` repairs", session.whole_bytes);
        rows.push(vec!["recording".to_owned(), whole]);
    }
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
    for (id, fit) in session.clocks {
        text.push_str(&format!(
            "clock {id}: residual p50 {:.1} µs, p95 {:.1} µs, max {:.1} µs over {} samples\n",
            fit.residuals.p50_ns / 1e3,
            fit.residuals.p95_ns / 1e3,
            fit.residuals.max_ns / 1e3,
            thousands(fit.samples)
        ));
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
            Incident::Warning { message } => message.clone(),
        };
        let stream = if entry.stream.is_empty() { "recorder" } else { &entry.stream };
        text.push_str(&format!("{stream}: {what}\n"));
    }
    if session.incident_count > 20 {
        text.push_str(&format!("and {} incidents more; --json lists them\n", session.incident_count - 20));
    }
    for damage in session.damage {
        text.push_str(&format!("damaged: {damage}\n"));
    }
    for encoding in session.unknown_encodings {
        text.push_str(&format!("erfgs does not decode events that are encoded as '{encoding}'\n"));
    }
    text
}
