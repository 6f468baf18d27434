//! A server of pages: a thread with a single-threaded runtime, which ends when it is dropped.

use std::{
    io,
    net::{SocketAddr, TcpListener},
    thread::{self, JoinHandle},
};

use axum::Router;
use tokio::sync::oneshot;

/// What answers at an address, until it is dropped.
#[derive(Debug)]
pub struct Server {
    address: SocketAddr,
    quit: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Server {
    /// Takes the address, for [`Server::start`]; port 0 takes any free one.
    ///
    /// # Errors
    /// If the address is taken, or the system refuses.
    pub fn listen(address: SocketAddr) -> io::Result<TcpListener> {
        let listener = TcpListener::bind(address)?;
        listener.set_nonblocking(true)?;
        Ok(listener)
    }

    /// Starts to answer as `router` does. `name` is that of the thread, and of the page in the log.
    ///
    /// # Errors
    /// If the system refuses.
    pub fn start(listener: TcpListener, router: Router, name: &'static str) -> io::Result<Self> {
        let address = listener.local_addr()?;
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().max_blocking_threads(4).build()?;
        let (quit, told) = oneshot::channel();
        let thread = thread::Builder::new().name(name.into()).spawn(move || {
            let serve = async move {
                let listener = match tokio::net::TcpListener::from_std(listener) {
                    Ok(listener) => listener,
                    Err(error) => return tracing::error!("the {name} does not start: {error}"),
                };
                let serve = std::future::IntoFuture::into_future(axum::serve(listener, router));
                // Streams of numbers never end by themselves, so that nothing waits for them.
                tokio::select! {
                    ended = serve => if let Err(error) = ended { tracing::error!("the {name} ended: {error}") },
                    _ = told => {}
                }
            };
            runtime.block_on(serve);
            runtime.shutdown_background();
        })?;
        Ok(Self { address, quit: Some(quit), thread: Some(thread) })
    }

    /// Where it listens.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.address
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        if let Some(quit) = self.quit.take() {
            let _ = quit.send(());
        }
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}
