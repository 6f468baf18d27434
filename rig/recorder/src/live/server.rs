//! Where the page is served.

use std::{
    net::{SocketAddr, TcpListener},
    sync::{Arc, OnceLock},
};

use erfgs_page::{
    access::Access,
    serve::{PageError, PageOptions, Server},
};

use super::{
    monitor::Monitor,
    playback::Playback,
    routes::{self, Site},
};
use crate::{Recorder, hosts::Hosts};

/// A page that is being served; ends when dropped.
pub struct LivePage {
    server: Server,
    access: Arc<Access>,
    site: Arc<Site>,
}

impl LivePage {
    /// Takes the address, for [`LivePage::serve_at`] later: who is to wait for checks and devices need not wait to be told
    /// that it is taken.
    ///
    /// # Errors
    /// If the address is taken, or the system refuses.
    pub fn listen(address: SocketAddr) -> Result<TcpListener, PageError> {
        Server::listen(address)
    }

    /// Starts to serve.
    ///
    /// # Errors
    /// If the address is taken, or the system refuses.
    pub fn serve(recorder: Arc<Recorder>, monitor: Arc<Monitor>, options: &PageOptions) -> Result<Self, PageError> {
        Self::serve_at(Self::listen(options.address)?, recorder, monitor, options)
    }

    /// Starts to serve where [`LivePage::listen`] listens, which is `options.address`.
    ///
    /// # Errors
    /// If the system refuses.
    pub fn serve_at(
        listener: TcpListener,
        recorder: Arc<Recorder>,
        monitor: Arc<Monitor>,
        options: &PageOptions,
    ) -> Result<Self, PageError> {
        let access = Arc::new(Access::new(options)?);
        let site = Arc::new(Site {
            recorder,
            monitor,
            access: Arc::clone(&access),
            playback: OnceLock::new(),
            hosts: OnceLock::new(),
        });
        let server = Server::start(listener, routes::router(Arc::clone(&site)), "live page")?;
        Ok(Self { server, access, site })
    }

    /// Lets the page steer a playback. The first one stays.
    pub fn steer(&self, playback: Arc<dyn Playback>) {
        let _ = self.site.playback.set(playback);
    }

    /// Lets the page show other hosts, too, and start and stop them with this one. The first ones stay.
    pub fn lead(&self, hosts: Arc<Hosts>) {
        let _ = self.site.hosts.set(hosts);
    }

    /// Where it listens.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.server.address()
    }

    /// The address to open, with the token where one is needed. An unspecified address (`0.0.0.0`) is to be replaced
    /// by one of the machine's own.
    #[must_use]
    pub fn url(&self) -> String {
        self.access.url(self.address())
    }
}
