//! All other hosts of a rig: watched, started before this one's recording, stopped with it.

use std::{
    collections::BTreeSet,
    future::Future,
    io,
    path::{Path, PathBuf},
    sync::{Arc, Mutex, MutexGuard, PoisonError, Weak, mpsc},
    thread,
    time::Duration,
};

use axum::{body::Bytes, http::StatusCode};
use erfgs_base::names::file_name;
use erfgs_page::background::Background;
use tokio::{task::JoinSet, time::sleep};

use super::{
    client::{Longest, ask},
    error::{HostError, StartError},
    host::{ASK, Host, HostEnd, HostTake},
    link::HostLink,
    merge::merge_commands,
    report::HostView,
};
use crate::{Level, RecordError, Recorder, Summary};

/// A picture, or a camera that is set.
const RELAY: Duration = Duration::from_secs(5);
/// Longest name of a session, without its suffix.
const NAME: usize = 100;

/// See the module. Ends to watch when it is dropped; recordings go on.
pub struct Hosts {
    shared: Arc<Shared>,
    background: Background,
    /// One recording is begun at a time.
    starting: Mutex<()>,
}

struct Shared {
    hosts: Vec<Arc<Host>>,
    /// This host's recorder: what is to be said goes to its log.
    own: Mutex<Weak<Recorder>>,
    /// One order at a time.
    order: tokio::sync::Mutex<()>,
    /// The session of this host that the others record with, while it does.
    leads: Mutex<Option<PathBuf>>,
    /// The session of this host and what the others recorded with it, of the last take.
    last: Mutex<Option<(PathBuf, Vec<HostTake>)>>,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Hosts {
    /// Asks all of them how they fare, and watches them from then on.
    ///
    /// # Errors
    /// If one cannot be asked, or cannot record.
    pub fn connect(links: Vec<HostLink>) -> Result<Self, HostError> {
        let mut names = BTreeSet::new();
        for link in &links {
            if !names.insert(link.name()) {
                return Err(HostError::Twice { host: link.name() });
            }
        }
        let shared = Arc::new(Shared {
            hosts: links.into_iter().map(|link| Arc::new(Host::new(link))).collect(),
            own: Mutex::new(Weak::new()),
            order: tokio::sync::Mutex::new(()),
            leads: Mutex::new(None),
            last: Mutex::new(None),
        });
        let hosts = Self { shared, background: Background::start("hosts")?, starting: Mutex::new(()) };
        let shared = Arc::clone(&hosts.shared);
        hosts.wait_for(async move { shared.are_ready(None).await })??;
        for host in &hosts.shared.hosts {
            hosts.background.spawn(watch(Arc::clone(&hosts.shared), Arc::clone(host)));
        }
        hosts.background.spawn(follow(Arc::clone(&hosts.shared)));
        Ok(hosts)
    }

    /// From now on `recorder` is this host's: its log says what happens to the others, and they stop when it does.
    pub fn lead(&self, recorder: &Arc<Recorder>) {
        *lock(&self.shared.own) = Arc::downgrade(recorder);
    }

    /// Lets all others record, and when each says that it does, `recorder`, into the new file `path`. `length` is how long this
    /// will take, if that is known. The sessions of the others are called as this one, and by their rigs.
    ///
    /// # Errors
    /// If one of them does not record: then none does.
    pub fn start(&self, recorder: &Recorder, path: &Path, length: Option<Duration>) -> Result<(), StartError> {
        let _alone = lock(&self.starting);
        if recorder.is_recording() {
            let status = recorder.status();
            let running = status.recording.as_ref().map(|recording| &recording.path).or(status.finishing.as_ref());
            return Err(RecordError::Busy(running.unwrap_or(&path.to_owned()).display().to_string()).into());
        }
        let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let shared = Arc::clone(&self.shared);
        let started = self.wait_for(async move { shared.start(&stem, length).await });
        started.map_err(|error| StartError::Host { error, stopped: Vec::new() })??;
        if let Err(error) = recorder.start_recording(path) {
            let shared = Arc::clone(&self.shared);
            let _ = self.wait_for(async move { shared.all_stopped().await });
            return Err(error.into());
        }
        *lock(&self.shared.leads) = Some(path.to_owned());
        Ok(())
    }

    /// Ends the recording of `recorder`, and those of all others.
    ///
    /// # Errors
    /// As [`Recorder::stop_recording`].
    pub fn stop(&self, recorder: &Recorder, reason: &str) -> Result<Summary, RecordError> {
        // At the same time: one of them may have much to write.
        thread::scope(|scope| {
            let others = scope.spawn(|| self.stop_others());
            let summary = recorder.stop_recording(reason);
            let _ = others.join();
            summary
        })
    }

    /// Ends the recordings of the others.
    fn stop_others(&self) {
        let shared = Arc::clone(&self.shared);
        let _ = self.wait_for(async move { shared.stop().await });
    }

    /// The last take that is over: the session of this host, and what the others recorded with it.
    #[must_use]
    pub fn last(&self) -> Option<(PathBuf, Vec<HostTake>)> {
        lock(&self.shared.last).clone()
    }

    /// How the others fare, in the order of their links.
    #[must_use]
    pub fn views(&self) -> Vec<HostView> {
        self.shared.hosts.iter().map(|host| host.view()).collect()
    }

    /// What a host of these answers to a request of the leading host's page, with the kind of what it is.
    pub(crate) async fn relay(
        &self,
        host: usize,
        path: &str,
        json: Option<String>,
    ) -> Option<Result<(StatusCode, String, Bytes), HostError>> {
        let host = self.shared.hosts.get(host)?;
        let answer = ask(&host.link, path, json, RELAY, Longest::Pictures).await;
        Some(answer.map(|answer| (answer.code, answer.kind, answer.body)))
    }

    /// Lets the thread of the hosts do something, and waits for what comes of it.
    fn wait_for<T: Send + 'static>(&self, what: impl Future<Output = T> + Send + 'static) -> Result<T, HostError> {
        let (done, answer) = mpsc::sync_channel(1);
        self.background.spawn(async move {
            let _ = done.send(what.await);
        });
        // The thread ends with `self`, so that only a fault of ours gets here.
        answer
            .recv()
            .map_err(|_| HostError::System(io::Error::other("the thread of the hosts ended: this is a bug of erfgs")))
    }
}

impl Shared {
    /// Does something with all hosts at once; what came of it, in their order.
    async fn each<T, F>(&self, what: impl Fn(Arc<Host>) -> F) -> Vec<T>
    where
        T: Send + 'static,
        F: Future<Output = T> + Send + 'static,
    {
        let mut tasks = JoinSet::new();
        for (index, host) in self.hosts.iter().enumerate() {
            let task = what(Arc::clone(host));
            tasks.spawn(async move { (index, task.await) });
        }
        let mut answers = tasks.join_all().await;
        answers.sort_by_key(|(index, _)| *index);
        answers.into_iter().map(|(_, answer)| answer).collect()
    }

    /// Whether all can record, for so long.
    async fn are_ready(&self, length: Option<Duration>) -> Result<(), HostError> {
        HostError::any_of(self.each(|host| async move { host.is_ready(length).await }).await)
    }

    async fn start(&self, stem: &str, length: Option<Duration>) -> Result<(), StartError> {
        let _alone = self.order.lock().await;
        let refused = |error| StartError::Host { error, stopped: Vec::new() };
        self.are_ready(length).await.map_err(refused)?;
        self.hosts.iter().for_each(|host| host.forget());
        let names = self.names(stem);
        let started = self.each(|host| {
            let name = names.get(&host.link.name()).cloned().unwrap_or_default();
            async move { host.start(&name).await }
        });
        let Err(error) = HostError::any_of(started.await) else { return Ok(()) };
        let stopped = self.all_stopped().await.into_iter();
        let stopped = stopped.filter(|take| !matches!(take.end, HostEnd::Unknown { .. })).map(|take| take.path);
        Err(StartError::Host { error, stopped: stopped.collect() })
    }

    /// What the others' sessions of a take are called.
    fn names(&self, stem: &str) -> std::collections::BTreeMap<String, String> {
        let mut given = BTreeSet::new();
        let name = |host: &Arc<Host>| {
            let rig = file_name(&host.rig().unwrap_or_default());
            let plain = |c: char| if c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.') { c } else { '_' };
            let base: String = format!("{stem}-{rig}").chars().map(plain).take(NAME - 4).collect();
            let base = base.trim_start_matches(['.', '-']).to_owned();
            let numbered = (2..).map(|number| format!("{base}-{number}"));
            let name = std::iter::once(base.clone()).chain(numbered).find(|name| given.insert(name.to_lowercase()));
            (host.link.name(), format!("{}.mcap", name.unwrap_or(base)))
        };
        self.hosts.iter().map(name).collect()
    }

    async fn all_stopped(&self) -> Vec<HostTake> {
        self.each(|host| async move { host.stop().await }).await.into_iter().flatten().collect()
    }

    /// Ends what the others record, and says what there is of it.
    async fn stop(&self) {
        let _alone = self.order.lock().await;
        let Some(own) = lock(&self.leads).take() else { return };
        let takes = self.all_stopped().await;
        for take in &takes {
            let (level, says) = take.says();
            self.say(level, &take.host, &says);
        }
        for command in merge_commands(&own, &takes) {
            self.say(Level::Info, "", &command);
        }
        *lock(&self.last) = Some((own, takes));
    }

    fn say(&self, level: Level, who: &str, what: &str) {
        if let Some(recorder) = lock(&self.own).upgrade() {
            recorder.say(level, who, what);
        }
    }
}

/// Asks a host again and again how it fares.
async fn watch(shared: Arc<Shared>, host: Arc<Host>) {
    loop {
        sleep(ASK).await;
        let name = host.link.name();
        for (level, stream, what) in host.look().await {
            let who = if stream.is_empty() { name.clone() } else { format!("{name} {stream}") };
            shared.say(level, &who, &what);
        }
        if host.is_overdue() {
            let _alone = shared.order.lock().await;
            // Another take may have begun while this waited.
            let late = if host.is_overdue() { host.stop().await } else { None };
            if let Some(take) = late.filter(|take| !matches!(take.end, HostEnd::Unknown { .. })) {
                let (level, says) = take.says();
                shared.say(level, &name, &format!("{says}, after the connection was restored"));
            }
        }
    }
}

/// Ends the recordings of the others when this host's ended by itself.
async fn follow(shared: Arc<Shared>) {
    loop {
        sleep(ASK).await;
        let own = lock(&shared.own).upgrade();
        let leads = lock(&shared.leads).is_some();
        if leads && own.is_some_and(|own| !own.is_recording()) {
            shared.stop().await;
        }
    }
}
