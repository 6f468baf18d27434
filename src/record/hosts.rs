//! `erfgs record --with`: other hosts, recorded with this one.

use std::{fs, path::Path, str::FromStr, sync::Arc};

use anyhow::Context;
use erfgs_base::names::printable;
use erfgs_recorder::{
    StreamState, StreamStatus,
    hosts::{HostEnd, HostLink, HostTake, HostView, Hosts, merge_commands},
};
use serde::Serialize;

use crate::{
    errors::Usage,
    progress::duration,
    terminal::{Terminal, bytes, table, thousands},
};

/// The longest file of links.
const LINKS_BYTES: u64 = 1 << 20;

/// A link, or a file of links. What it says is secret, and is never shown.
#[derive(Clone)]
pub struct With(String);

impl std::fmt::Debug for With {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str("With(..)")
    }
}

impl FromStr for With {
    type Err = std::convert::Infallible;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Ok(Self(text.to_owned()))
    }
}

impl With {
    fn links(&self) -> anyhow::Result<Vec<HostLink>> {
        let path = Path::new(&self.0);
        if self.0.contains("://") || !path.exists() {
            return Ok(vec![HostLink::parse(&self.0).map_err(|error| Usage(error.to_string()))?]);
        }
        let shown = path.display();
        if fs::metadata(path).is_ok_and(|about| !about.is_file() || about.len() > LINKS_BYTES) {
            return Err(Usage(format!("'{shown}' is no file of links")).into());
        }
        let text = fs::read_to_string(path).with_context(|| format!("cannot read '{shown}'"))?;
        let lines = text.lines().map(str::trim).enumerate();
        let links = lines.filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
        let link =
            |(at, line)| HostLink::parse(line).map_err(|error| Usage(format!("'{shown}', line {}: {error}", at + 1)));
        let links = links.map(link).collect::<Result<Vec<_>, _>>()?;
        if links.is_empty() {
            return Err(Usage(format!("'{shown}' has no links: write the link of a live page in each line")).into());
        }
        Ok(links)
    }
}

/// Asks the hosts how they fare, and watches them from then on.
pub fn connect(with: &[With], terminal: &Terminal) -> anyhow::Result<Option<Arc<Hosts>>> {
    let mut links = Vec::new();
    for with in with {
        links.extend(with.links()?);
    }
    if links.is_empty() {
        return Ok(None);
    }
    let hosts = Hosts::connect(links)?;
    for host in hosts.views() {
        let Some(status) = host.status() else { continue };
        let streams = match status.streams.len() {
            1 => "1 stream".to_owned(),
            count => format!("{count} streams"),
        };
        let rig = printable(&status.rig);
        terminal.note(format!("with host {}: rig '{rig}', {streams}", host.name));
        let silent = |stream: &&StreamStatus| matches!(stream.state, StreamState::Lost | StreamState::Stalled);
        for stream in status.streams.iter().filter(silent) {
            let id = printable(&stream.id);
            terminal.note(format!("WARNING host {}: no data come from '{id}': see its messages there", host.name));
        }
    }
    Ok(Some(Arc::new(hosts)))
}

/// ` | 2 hosts: 412.0 MB/s, dropped 0 | LOST 10.0.0.3:8100`
pub fn line(hosts: &[HostView]) -> String {
    if hosts.is_empty() {
        return String::new();
    }
    let heard = || hosts.iter().filter(|host| host.lost.is_none()).filter_map(HostView::status);
    let recording = heard().filter(|status| status.recording.is_some()).count();
    let rate = heard().fold(0.0, |sum, status| sum + status.bytes_per_s());
    let drops: u64 = heard().map(|status| status.drops()).sum();
    let mut line = format!(
        " | {recording} of {} other hosts recording, {:.1} MB/s, dropped {}",
        hosts.len(),
        rate / 1e6,
        thousands(drops)
    );
    for host in hosts.iter().filter(|host| host.lost.is_some()) {
        line.push_str(&format!(" | LOST {}", host.name));
    }
    line
}

/// What the others recorded, and how it becomes one session.
#[derive(Serialize)]
pub struct Others {
    hosts: Vec<HostTake>,
    /// Commands that fetch their sessions and merge them.
    merge: Vec<String>,
}

impl Others {
    /// Of the last take.
    pub fn of(hosts: &Hosts) -> Self {
        let Some((own, hosts)) = hosts.last() else { return Self { hosts: Vec::new(), merge: Vec::new() } };
        let merge = merge_commands(&own, &hosts);
        Self { hosts, merge }
    }

    /// For humans.
    pub fn report(&self) -> String {
        if self.hosts.is_empty() {
            return String::new();
        }
        let mut rows =
            vec![["host", "length", "data", "packets", "dropped", "session there"].map(String::from).to_vec()];
        for take in &self.hosts {
            let mut row = vec![take.host.clone()];
            row.extend(match &take.end {
                HostEnd::Stopped(summary) | HostEnd::Early(summary) => [
                    duration(summary.seconds),
                    bytes(summary.bytes),
                    thousands(summary.streams.iter().map(|stream| stream.written).sum()),
                    thousands(summary.drops()),
                ],
                HostEnd::Unknown { seconds, bytes: length, .. } => {
                    [format!("{} or more", duration(*seconds)), bytes(*length), "?".into(), "?".into()]
                }
            });
            row.push(take.path.display().to_string());
            rows.push(row);
        }
        let mut text = format!("\n{}", table(&rows));
        for take in self.hosts.iter().filter(|take| !is_whole(take)) {
            text.push_str(&format!("{}: {}\n", take.host, take.says().1));
        }
        text.push_str("\nTo make one session of them:\n");
        for command in &self.merge {
            text.push_str(&format!("  {command}\n"));
        }
        text
    }

    /// An error where a host did not record to the end.
    pub fn fault(&self) -> anyhow::Result<()> {
        let lost: Vec<&str> = self.hosts.iter().filter(|take| !is_whole(take)).map(|take| take.host.as_str()).collect();
        if !lost.is_empty() {
            anyhow::bail!("did not record to the end: {}; all else is complete", lost.join(", "));
        }
        Ok(())
    }
}

fn is_whole(take: &HostTake) -> bool {
    matches!(&take.end, HostEnd::Stopped(summary) if summary.failure.is_none())
}
