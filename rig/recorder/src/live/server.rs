//! Where the page is served.

use std::{
    io,
    net::{SocketAddr, TcpListener},
    sync::Arc,
};

use erfgs_page::{access::Access, serve::Server};

use super::{
    monitor::Monitor,
    routes::{self, Site},
};
use crate::Recorder;

/// How to serve.
#[derive(Clone, Debug)]
pub struct LiveOptions {
    /// Address to listen at; port 0 takes any free one.
    pub address: SocketAddr,
    /// Names that the machine may be called by, besides `localhost` and bare addresses.
    pub names: Vec<String>,
}

/// What keeps the page from being served.
#[derive(Debug, thiserror::Error)]
pub enum LiveError {
    /// The address.
    #[error("cannot serve the live page at {address}: {source}. Choose another port, or 0 for any free one")]
    Listen {
        /// The address.
        address: SocketAddr,
        /// What the system says.
        source: io::Error,
    },
    /// The rest of the system.
    #[error("cannot start the live page: {0}")]
    Start(#[from] io::Error),
    /// No random numbers.
    #[error("cannot draw the token of the live page: {0}")]
    Token(getrandom::Error),
}

/// A page that is being served; ends when dropped.
pub struct LivePage {
    server: Server,
    access: Arc<Access>,
}

impl LivePage {
    /// Takes the address, for [`LivePage::serve_at`] later: who is to wait for checks and devices need not wait to be told
    /// that it is taken.
    ///
    /// # Errors
    /// If the address is taken, or the system refuses.
    pub fn listen(address: SocketAddr) -> Result<TcpListener, LiveError> {
        Server::listen(address).map_err(|source| LiveError::Listen { address, source })
    }

    /// Starts to serve.
    ///
    /// # Errors
    /// If the address is taken, or the system refuses.
    pub fn serve(recorder: Arc<Recorder>, monitor: Arc<Monitor>, options: &LiveOptions) -> Result<Self, LiveError> {
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
        options: &LiveOptions,
    ) -> Result<Self, LiveError> {
        let access = Access::for_address(&options.address, options.names.clone()).map_err(LiveError::Token)?;
        let access = Arc::new(access);
        let site = Arc::new(Site { recorder, monitor, access: Arc::clone(&access) });
        Ok(Self { server: Server::start(listener, routes::router(site), "live page")?, access })
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
