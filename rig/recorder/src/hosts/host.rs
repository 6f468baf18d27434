//! One other host: asked several times a second how it fares, told to record and to stop.

use std::{
    path::{Path, PathBuf},
    sync::{
        Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, Ordering::Relaxed},
    },
    time::{Duration, Instant},
};

use axum::http::StatusCode;
use erfgs_base::names::printable;
use serde::Serialize;
use tokio::time::sleep;

use super::{
    bounded,
    client::{Answer, Longest, ask},
    error::HostError,
    link::HostLink,
    report::{HostReport, HostView},
};
use crate::{Level, Status, Summary};

/// Between two questions how it fares.
pub(super) const ASK: Duration = Duration::from_millis(250);
/// A status is short and at hand, and its host may be busy.
const STATUS: Duration = Duration::from_secs(4);
/// An order may wait for a disk.
const ORDER: Duration = Duration::from_secs(10);
/// A host that was silent for so long is lost, for the time being.
const LOST: Duration = Duration::from_secs(3);
/// For so long a host that is to stop is asked again.
const GIVE_UP: Duration = Duration::from_secs(10);
/// For so long a host is told to stop that answers and records on: it may have much to write.
const REFUSES: Duration = Duration::from_secs(20);
/// Warnings and errors of a host that are told in a while; it has a page for more.
const MOST_MESSAGES: usize = 20;
/// That while.
const WHILE: Duration = Duration::from_secs(60);
/// For so long a host may say that nothing is recorded yet after it was told to.
const BEGIN: Duration = Duration::from_secs(10);
/// For so long a recording from before may still be being completed.
const COMPLETED: Duration = Duration::from_secs(60);

/// How what a host recorded came to its end.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "end", content = "detail", rename_all = "kebab-case")]
pub enum HostEnd {
    /// It was stopped with the others.
    Stopped(Box<Summary>),
    /// It ended before, for its own reasons.
    Early(Box<Summary>),
    /// The host did not say how it ended.
    Unknown {
        /// Why not.
        why: String,
        /// How much there was when it was heard of last, seconds.
        seconds: f64,
        /// The same, bytes.
        bytes: u64,
    },
}

/// What another host recorded, and where.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct HostTake {
    /// The host, with its port.
    pub host: String,
    /// The host.
    #[serde(skip)]
    pub address: String,
    /// The session there.
    pub path: PathBuf,
    /// How it ended.
    #[serde(flatten)]
    pub end: HostEnd,
}

impl HostTake {
    /// Files that the session is in, as far as the host said.
    #[must_use]
    pub fn files(&self) -> u32 {
        match &self.end {
            HostEnd::Stopped(summary) | HostEnd::Early(summary) => summary.files,
            HostEnd::Unknown { .. } => 1,
        }
    }

    /// What there is to know about its end, in words; with what to do where something is wrong.
    #[must_use]
    pub fn says(&self) -> (Level, String) {
        let (path, host) = (self.path.display(), &self.host);
        match &self.end {
            HostEnd::Stopped(summary) => match &summary.failure {
                None => (Level::Info, format!("recorded {:.1} s into '{path}' there", summary.seconds)),
                Some(failure) => (Level::Error, format!("{failure}; '{path}' there holds {:.1} s", summary.seconds)),
            },
            HostEnd::Early(summary) => {
                let why = summary.failure.as_ref().unwrap_or(&summary.reason);
                (
                    Level::Error,
                    format!(
                        "its recording ended before the others: {why}. '{path}' there holds {:.1} s",
                        summary.seconds
                    ),
                )
            }
            HostEnd::Unknown { why, seconds, .. } => (
                Level::Error,
                format!(
                    "{why}. '{path}' there holds {seconds:.1} s or more: what it recorded can be merged as it is; if it records \
                     on, stop it on its page, http://{host}/"
                ),
            ),
        }
    }
}

/// A recording of this host that belongs to one of ours.
struct Take {
    /// Name of the session, without a folder.
    name: String,
    path: PathBuf,
    /// How much there was of it when it was heard of last.
    seconds: f64,
    bytes: u64,
    /// Once it ended, how.
    end: Option<HostEnd>,
    /// Whether ours is over.
    over: bool,
}

#[derive(Default)]
struct State {
    report: Option<HostReport>,
    answered: Option<Instant>,
    /// Why it does not answer now.
    silent: Option<String>,
    /// Whether it was said to be lost.
    lost: bool,
    take: Option<Take>,
    last_message: Option<u64>,
    /// Messages that were told, and left out, since then.
    telling: Option<(Instant, usize, usize)>,
}

/// See the module.
pub(super) struct Host {
    pub link: HostLink,
    state: Mutex<State>,
    /// Whether an order is under way, which says itself what comes of it.
    ordered: AtomicBool,
}

/// A message about a host: its level, the stream there (or nothing), the text.
pub(super) type HostMessage = (Level, String, String);

impl Host {
    pub fn new(link: HostLink) -> Self {
        Self { link, state: Mutex::default(), ordered: AtomicBool::new(false) }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// How it fares now.
    pub async fn status(&self) -> Result<Status, HostError> {
        let answer = ask(&self.link, "/api/status", None, STATUS, Longest::Words).await?;
        let report = self.understood(&answer)?;
        let status = report.status.clone();
        let mut state = self.state();
        let newest = status.messages.last().map(|message| message.number);
        state.last_message = state.last_message.or(Some(newest.unwrap_or(0)));
        if let Some((take, running)) = state.take.as_mut().zip(status.recording.as_ref())
            && running.path.file_name() == Some(take.name.as_ref())
        {
            (take.seconds, take.bytes) = (running.seconds, running.bytes);
        }
        (state.report, state.answered, state.silent) = (Some(report), Some(Instant::now()), None);
        Ok(status)
    }

    fn understood(&self, answer: &Answer) -> Result<HostReport, HostError> {
        let foreign = |what: String| HostError::Foreign { host: self.link.name(), what: printable(&what) };
        if answer.code != StatusCode::OK {
            return Err(foreign(format!("it answers {}", answer.code)));
        }
        bounded::read(&answer.body).map_err(|error| foreign(error.to_string()))
    }

    /// What the page shows of it.
    pub fn view(&self) -> HostView {
        let state = self.state();
        let name = self.link.name();
        HostView {
            page: format!("http://{name}/"),
            name,
            lost: state.silent.clone().filter(|_| state.lost),
            report: state.report.clone(),
        }
    }

    /// The name of its rig, once it was heard of.
    pub fn rig(&self) -> Option<String> {
        self.state().report.as_ref().map(|report| report.status.rig.clone())
    }

    /// Asks how it fares, and gives what is new to be said.
    pub async fn look(&self) -> Vec<HostMessage> {
        let status = self.status().await;
        let mut state = self.state();
        let mut messages = Vec::new();
        match status {
            Err(error) => {
                let silent_for = state.answered.map_or(Duration::MAX, |at| at.elapsed());
                state.silent = Some(self.named_before(&error));
                if !state.lost && (silent_for >= LOST || matches!(error, HostError::Token { .. })) {
                    state.lost = true;
                    messages.push((Level::Error, String::new(), self.without(&state, &error)));
                }
            }
            Ok(status) => {
                if std::mem::take(&mut state.lost) {
                    messages.push((Level::Warning, String::new(), "it answers again".into()));
                }
                messages.extend(new_messages(&mut state, &status));
                if !self.ordered.load(Relaxed) {
                    messages.extend(self.ended(&mut state, &status));
                }
            }
        }
        messages
    }

    /// An error where the host's name stands before it already.
    fn named_before(&self, error: &HostError) -> String {
        let says = error.to_string();
        let named = format!("host {} ", self.link.name());
        says.strip_prefix(&named).map_or(says.clone(), str::to_owned)
    }

    /// What it means that it does not answer.
    fn without(&self, state: &State, error: &HostError) -> String {
        let says = self.named_before(error);
        match state.take.as_ref().filter(|take| take.end.is_none()) {
            None => says,
            Some(take) => format!(
                "{says}. The others go on; what it recorded is in '{}' there, and if it records on by itself, that too",
                take.path.display()
            ),
        }
    }

    /// Notes that its recording ended without us, if it did.
    fn ended(&self, state: &mut State, status: &Status) -> Option<HostMessage> {
        let take = state.take.as_mut().filter(|take| take.end.is_none())?;
        take.end = Some(end_of(take, status)?);
        let (level, says) = self.host_take(take)?.says();
        Some((level, String::new(), format!("{says}. The others go on")))
    }

    /// Whether it still records what should have ended, since it could not be told.
    pub fn is_overdue(&self) -> bool {
        self.state().take.as_ref().is_some_and(|take| take.over && matches!(take.end, Some(HostEnd::Unknown { .. })))
            && self.state().silent.is_none()
    }

    /// Whether it can record, into `name`, for so long.
    ///
    /// # Errors
    /// With what keeps it.
    pub async fn is_ready(&self, length: Option<Duration>) -> Result<(), HostError> {
        let host = || self.link.name();
        let until = Instant::now() + COMPLETED;
        let mut status = self.status().await?;
        while status.finishing.is_some() && Instant::now() < until {
            sleep(ASK).await;
            status = self.status().await?;
        }
        if status.replay {
            return Err(HostError::Replay { host: host() });
        }
        let running = status.recording.map(|recording| recording.path).or(status.finishing);
        if let Some(path) = running {
            return Err(HostError::Busy { host: host(), path: PathBuf::from(printable(&path.to_string_lossy())) });
        }
        let disk = status.disk;
        let lasts = length.zip(disk.seconds_left).filter(|(length, left)| *left < length.as_secs_f64());
        if disk.total > 0 && (disk.free == 0 || lasts.is_some()) {
            let room = match lasts {
                Some((length, left)) => format!("{left:.0} s of {:.0} s at the present rate", length.as_secs_f64()),
                None => "nothing is left".into(),
            };
            return Err(HostError::Disk { host: host(), room, folder: self.folder() });
        }
        Ok(())
    }

    fn folder(&self) -> PathBuf {
        let state = self.state();
        let folder = state.report.as_ref().map(|report| report.folder.to_string_lossy().into_owned());
        PathBuf::from(printable(&folder.unwrap_or_default()))
    }

    /// Lets it record into a new session of this name, and waits until it says that it does.
    ///
    /// # Errors
    /// With what keeps it.
    pub async fn start(&self, name: &str) -> Result<PathBuf, HostError> {
        let path = self.folder().join(name);
        let take = Take { name: name.into(), path: path.clone(), seconds: 0.0, bytes: 0, end: None, over: false };
        let _ordered = Ordered::by(&self.ordered);
        let json = serde_json::json!({ "name": name }).to_string();
        // Before it is told: should its answer be lost, it is to be stopped all the same.
        self.state().take = Some(take);
        let answer = ask(&self.link, "/api/start", Some(json), ORDER, Longest::Words).await?;
        if answer.code != StatusCode::OK {
            self.forget();
            return Err(HostError::Refused { host: self.link.name(), why: reason(&answer) });
        }
        let until = Instant::now() + BEGIN;
        while Instant::now() < until {
            let recording = self.status().await?.recording;
            if recording.is_some_and(|recording| recording.path.file_name() == Some(name.as_ref())) {
                return Ok(path);
            }
            sleep(ASK / 5).await;
        }
        Err(HostError::NotBegun { host: self.link.name(), seconds: BEGIN.as_secs() })
    }

    /// Ends what it records for us, if it does, and gives what there is: `None` where it was never told to.
    pub async fn stop(&self) -> Option<HostTake> {
        let _ordered = Ordered::by(&self.ordered);
        let (name, patience) = {
            let mut state = self.state();
            let lost = state.silent.is_some();
            let take = state.take.as_mut()?;
            take.over = true;
            let known = take.end.as_ref().is_some_and(|end| !matches!(end, HostEnd::Unknown { .. }));
            // Who did not stop is told again, and nobody waits for it.
            let refuses = if take.end.is_some() { Duration::ZERO } else { REFUSES };
            (take.name.clone(), (!known).then_some((if lost { LOST } else { GIVE_UP }, refuses)))
        };
        if let Some((patience, refuses)) = patience {
            let end = self.end_recording(&name, patience, refuses).await;
            if let Some(take) = &mut self.state().take {
                take.end = Some(end);
            }
        }
        let state = self.state();
        self.host_take(state.take.as_ref()?)
    }

    async fn end_recording(&self, name: &str, patience: Duration, refuses: Duration) -> HostEnd {
        let mut ordered_at: Option<Instant> = None;
        let ours = |path: &Path| path.file_name() == Some(name.as_ref());
        let (begun, mut heard) = (Instant::now(), Instant::now());
        loop {
            let why = match self.status().await {
                Err(error) => self.named_before(&error),
                Ok(status) => {
                    heard = Instant::now();
                    if status.recording.as_ref().is_some_and(|recording| ours(&recording.path)) {
                        let since = *ordered_at.get_or_insert_with(Instant::now);
                        // It may have ended by itself meanwhile, or the answer be lost: then its status tells.
                        let answer = ask(&self.link, "/api/stop", Some("{}".into()), ORDER, Longest::Words).await;
                        let summary: Option<Summary> = answer.ok().and_then(|answer| bounded::read(&answer.body).ok());
                        if let Some(summary) = summary.filter(|summary| ours(&summary.path)) {
                            return HostEnd::Stopped(Box::new(printed(&summary)));
                        }
                        if since.elapsed() >= refuses {
                            let seconds = since.elapsed().as_secs();
                            return self.unknown(format!("it still records {seconds} s after it was told to stop"));
                        }
                    } else if let Some(end) = self.state().take.as_ref().and_then(|take| end_of(take, &status)) {
                        return match end {
                            HostEnd::Early(summary) if ordered_at.is_some() => HostEnd::Stopped(summary),
                            end => end,
                        };
                    }
                    "it does not confirm that its recording is complete".into()
                }
            };
            // Whatever it says, the end of this is known.
            if heard.elapsed() >= patience || begun.elapsed() >= COMPLETED + refuses {
                return self.unknown(why);
            }
            sleep(ASK / 5).await;
        }
    }

    /// What is known where a host does not say how its take ended.
    fn unknown(&self, why: String) -> HostEnd {
        let state = self.state();
        let (seconds, bytes) = state.take.as_ref().map_or((0.0, 0), |take| (take.seconds, take.bytes));
        HostEnd::Unknown { why, seconds, bytes }
    }

    fn host_take(&self, take: &Take) -> Option<HostTake> {
        let end = take.end.clone()?;
        Some(HostTake { host: self.link.name(), address: self.link.host().into(), path: take.path.clone(), end })
    }

    /// Forgets what it recorded for us before.
    pub fn forget(&self) {
        self.state().take = None;
    }
}

/// How a take ended that is no longer recorded by what its host says; `None` while it is recorded or completed.
fn end_of(take: &Take, status: &Status) -> Option<HostEnd> {
    let ours = |path: &Path| path.file_name() == Some(take.name.as_ref());
    let running = status.recording.as_ref().map(|recording| &recording.path);
    if running.into_iter().chain(&status.finishing).any(|path| ours(path)) {
        return None;
    }
    Some(match status.last.as_ref().filter(|last| ours(&last.path)) {
        Some(last) => HostEnd::Early(Box::new(printed(last))),
        None => HostEnd::Unknown {
            why: "its recorder was restarted in the meantime".into(),
            seconds: take.seconds,
            bytes: take.bytes,
        },
    })
}

/// A summary whose words can be shown.
fn printed(summary: &Summary) -> Summary {
    let failure = summary.failure.as_deref().map(printable);
    Summary { reason: printable(&summary.reason), failure, ..summary.clone() }
}

/// Warnings and errors of the host that were not told yet.
fn new_messages(state: &mut State, status: &Status) -> Vec<HostMessage> {
    let newest = status.messages.last().map_or(0, |message| message.number);
    let last = state.last_message.unwrap_or(newest);
    // A recorder that was started again counts anew.
    let last = if newest < last { 0 } else { last };
    state.last_message = Some(newest);
    let new = status.messages.iter().filter(|message| message.number > last && message.level != Level::Info);
    let new = new.map(|message| (message.level, printable(&message.stream), printable(&message.text)));
    few(&mut state.telling, new.collect(), Instant::now())
}

/// As many messages as are told in a while; once that is over, how many there were besides.
fn few(telling: &mut Option<(Instant, usize, usize)>, new: Vec<HostMessage>, now: Instant) -> Vec<HostMessage> {
    let mut messages = Vec::new();
    if let Some((since, _, left_out)) = *telling
        && now.duration_since(since) >= WHILE
    {
        *telling = None;
        if left_out > 0 {
            messages.push((Level::Warning, String::new(), format!("{left_out} more messages are shown on its page")));
        }
    }
    for message in new {
        let (_, shown, left_out) = telling.get_or_insert((now, 0, 0));
        if *shown < MOST_MESSAGES {
            *shown += 1;
            messages.push(message);
        } else {
            *left_out += 1;
        }
    }
    messages
}

/// What a refusal says.
fn reason(answer: &Answer) -> String {
    let body: Option<serde_json::Value> = serde_json::from_slice(&answer.body).ok();
    let error = body.as_ref().and_then(|body| body["error"].as_str()).map(str::to_owned);
    let plain = || String::from_utf8_lossy(&answer.body).chars().take(300).collect();
    let why: String = error.unwrap_or_else(plain);
    if why.is_empty() { answer.code.to_string() } else { printable(&why) }
}

/// While it lives, an order is under way.
struct Ordered<'a>(&'a AtomicBool);

impl<'a> Ordered<'a> {
    fn by(ordered: &'a AtomicBool) -> Self {
        ordered.store(true, Relaxed);
        Self(ordered)
    }
}

impl Drop for Ordered<'_> {
    fn drop(&mut self) {
        self.0.store(false, Relaxed);
    }
}

#[cfg(test)]
#[path = "host_tests.rs"]
mod tests;
