//! Who gets what a session plays: a count, or the recorder and its live page.

use std::{
    net::SocketAddr,
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
    },
};

use erfgs_recorder::{
    Input, MachineFacts, RecordConfig, Recorder, SessionInfo, folder_of,
    live::{LivePage, Monitor, MonitorOptions, PageOptions},
};
use erfgs_replay::{PlayedSource, Player};
use erfgs_session::source::{Incident, Outlet, Packet, Source};

use super::{Arguments, PlayedStream, steering::Steering};
use crate::record::options;

/// Of each stream so many bytes may wait for the disk when what plays is recorded.
const QUEUE_BYTES: usize = 64 << 20;

/// See the module.
pub enum Audience {
    Counting(Vec<(PlayedSource, Arc<Counting>)>),
    Live { recorder: Arc<Recorder>, page: LivePage },
}

/// Counts what passes.
#[derive(Default)]
pub struct Counting {
    packets: AtomicU64,
    bytes: AtomicU64,
    incidents: AtomicU64,
}

impl Outlet for Counting {
    fn send(&self, packet: Packet) -> bool {
        self.packets.fetch_add(1, Ordering::Relaxed);
        self.bytes.fetch_add(packet.payload.len() as u64, Ordering::Relaxed);
        true
    }

    fn report(&self, _incident: Incident) {
        self.incidents.fetch_add(1, Ordering::Relaxed);
    }
}

impl Audience {
    /// Nobody looks; what passes is counted.
    pub fn counting(player: &Player) -> Self {
        Self::Counting(player.sources().into_iter().map(|source| (source, Arc::default())).collect())
    }

    /// The recorder watches the streams as it would watch devices, and serves its page.
    pub fn live(player: &Player, arguments: &Arguments, address: SocketAddr) -> anyhow::Result<Self> {
        let sources = player.sources();
        let descriptions: Vec<_> = sources.iter().map(|source| source.description().clone()).collect();
        let monitor = Monitor::new(&descriptions, MonitorOptions::default())?;
        monitor.of_playback();
        arguments.quick.start(&descriptions, &monitor)?;
        let session = &arguments.session;
        let input =
            |source| Input { source: Box::new(source) as Box<dyn Source>, queue_bytes: QUEUE_BYTES, stall_after: None };
        let summary = player.summary();
        let name = session.file_stem().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let info = SessionInfo {
            rig: name,
            replay: true,
            configuration: summary.rig.clone().unwrap_or_default(),
            program: concat!("erfgs ", env!("CARGO_PKG_VERSION"), " replay").into(),
            machine: MachineFacts::gather(),
            warnings: Vec::new(),
            begin_host_ns: None,
        };
        let options = options(&RecordConfig::default(), info, folder_of(session), &monitor, None);
        let recorder = Arc::new(Recorder::new(sources.into_iter().map(input).collect(), options)?);
        let page = LivePage::serve(
            Arc::clone(&recorder),
            monitor,
            &PageOptions { address, names: arguments.live_name.clone(), open: arguments.open },
        )?;
        page.steer(Arc::new(Steering::new(player, arguments.repeat)));
        Ok(Self::Live { recorder, page })
    }

    /// Address of the page, if there is one.
    pub fn url(&self) -> Option<String> {
        match self {
            Self::Counting(_) => None,
            Self::Live { page, .. } => Some(page.url()),
        }
    }

    /// The playback starts.
    pub fn start(&mut self) -> anyhow::Result<()> {
        match self {
            Self::Counting(streams) => streams
                .iter_mut()
                .try_for_each(|(source, counting)| source.start(counting.clone()).map_err(anyhow::Error::from_boxed)),
            Self::Live { recorder, .. } => Ok(recorder.start_sources()?),
        }
    }

    /// The playback stops; a recording that runs is completed.
    pub fn stop(&mut self) -> anyhow::Result<()> {
        match self {
            Self::Counting(streams) => {
                streams.iter_mut().try_for_each(|(source, _)| source.stop().map_err(anyhow::Error::from_boxed))
            }
            Self::Live { recorder, .. } => {
                recorder.stop_sources();
                if recorder.is_recording() {
                    recorder.stop_recording("the playback was ended")?;
                }
                Ok(())
            }
        }
    }

    /// What passed so far.
    pub fn streams(&self) -> Vec<PlayedStream> {
        match self {
            Self::Counting(streams) => {
                let played = |(source, counting): &(PlayedSource, Arc<Counting>)| PlayedStream {
                    id: source.description().id.clone(),
                    packets: counting.packets.load(Ordering::Relaxed),
                    bytes: counting.bytes.load(Ordering::Relaxed),
                    incidents: Some(counting.incidents.load(Ordering::Relaxed)),
                };
                streams.iter().map(played).collect()
            }
            Self::Live { recorder, .. } => {
                let status = recorder.status();
                let played = |stream: &erfgs_recorder::StreamStatus| PlayedStream {
                    id: stream.id.clone(),
                    packets: stream.counters.packets,
                    bytes: stream.counters.bytes,
                    // The page tells them.
                    incidents: None,
                };
                status.streams.iter().map(played).collect()
            }
        }
    }
}
