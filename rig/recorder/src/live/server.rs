//! The server: a thread with a single-threaded runtime, which ends with the page.

use std::{
    io,
    net::{SocketAddr, TcpListener},
    sync::Arc,
    thread::{self, JoinHandle},
};

use erfgs_page::access::Access;
use tokio::sync::oneshot;

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
    address: SocketAddr,
    access: Arc<Access>,
    quit: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl LivePage {
    /// Takes the address, for [`LivePage::serve_at`] later: who is to wait for checks and devices need not wait to be told
    /// that it is taken.
    ///
    /// # Errors
    /// If the address is taken, or the system refuses.
    pub fn listen(address: SocketAddr) -> Result<TcpListener, LiveError> {
        let failed = |source| LiveError::Listen { address, source };
        let listener = TcpListener::bind(address).map_err(failed)?;
        listener.set_nonblocking(true).map_err(failed)?;
        Ok(listener)
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
        let address = listener.local_addr().map_err(|source| LiveError::Listen { address: options.address, source })?;
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().max_blocking_threads(4).build()?;
        let (quit, told) = oneshot::channel();
        let site = Arc::new(Site { recorder, monitor, access: Arc::clone(&access) });
        let thread = thread::Builder::new().name("live-page".into()).spawn(move || {
            let serve = async move {
                let listener = match tokio::net::TcpListener::from_std(listener) {
                    Ok(listener) => listener,
                    Err(error) => return tracing::error!("the live page does not start: {error}"),
                };
                let serve = std::future::IntoFuture::into_future(axum::serve(listener, routes::router(site)));
                // Streams of numbers never end by themselves, so that nothing waits for them.
                tokio::select! {
                    ended = serve => if let Err(error) = ended { tracing::error!("the live page ended: {error}") },
                    _ = told => {}
                }
            };
            runtime.block_on(serve);
            runtime.shutdown_background();
        })?;
        Ok(Self { address, access, quit: Some(quit), thread: Some(thread) })
    }

    /// Where it listens.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// The address to open, with the token where one is needed. An unspecified address (`0.0.0.0`) is to be replaced
    /// by one of the machine's own.
    #[must_use]
    pub fn url(&self) -> String {
        match &self.access.token {
            Some(token) => format!("http://{}/?token={}", self.address, token.reveal()),
            None => format!("http://{}/", self.address),
        }
    }
}

impl Drop for LivePage {
    fn drop(&mut self) {
        if let Some(quit) = self.quit.take() {
            let _ = quit.send(());
        }
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}
