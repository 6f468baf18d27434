//! A server of pages: a thread with a single-threaded runtime, which ends when it is dropped.
//!
//! Who connects and asks nothing takes a place only for a while: connections are bounded in number, and a request must be
//! whole within ten seconds. So many descriptors are the most that a page takes from the program that it belongs to.

use std::{
    collections::VecDeque,
    io,
    net::{SocketAddr, TcpListener},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::Duration,
};

use axum::{Router, body::Body};
use hyper::{body::Incoming, server::conn::http1, service::service_fn};
use hyper_util::rt::{TokioIo, TokioTimer};
use tokio::{
    net::TcpStream,
    task::{AbortHandle, JoinSet},
};
use tower_service::Service;

use crate::background::Background;

/// How long a connection may take until its next request is whole.
const PATIENCE: Duration = Duration::from_secs(10);
/// Connections at a time. A browser opens six, and one for each stream of numbers.
const CONNECTIONS: usize = 128;

/// How to serve a page.
#[derive(Clone, Debug)]
pub struct PageOptions {
    /// Address to listen at; port 0 takes any free one.
    pub address: SocketAddr,
    /// Names that the machine may be called by, besides `localhost` and bare addresses.
    pub names: Vec<String>,
    /// Whether every user of this machine may see the page without its token; of loopback addresses alone.
    pub open: bool,
}

/// What keeps a page from being served.
#[derive(Debug, thiserror::Error)]
pub enum PageError {
    /// The address.
    #[error("cannot serve a page at {address}: {source}. Choose another port, or port 0 for any free one")]
    Listen {
        /// The address.
        address: SocketAddr,
        /// What the system says.
        source: io::Error,
    },
    /// The page would be open to the network.
    #[error("a page without a token can be served at 127.0.0.1 alone, not at {address}")]
    Open {
        /// The address.
        address: SocketAddr,
    },
    /// The rest of the system.
    #[error("cannot start to serve a page: {0}")]
    Start(#[from] io::Error),
    /// No random numbers.
    #[error("cannot draw the token of a page: {0}")]
    Token(getrandom::Error),
}

/// What answers at an address, until it is dropped.
#[derive(Debug)]
pub struct Server {
    address: SocketAddr,
    /// Streams of numbers never end by themselves, so that nothing waits for them.
    _background: Background,
}

impl Server {
    /// Takes the address, for [`Server::start`]; port 0 takes any free one.
    ///
    /// # Errors
    /// [`PageError::Listen`] if the address is taken, or the system refuses.
    pub fn listen(address: SocketAddr) -> Result<TcpListener, PageError> {
        let taken = |source| PageError::Listen { address, source };
        let listener = TcpListener::bind(address).map_err(taken)?;
        listener.set_nonblocking(true).map_err(taken)?;
        Ok(listener)
    }

    /// Starts to answer as `router` does. `name` is that of the thread, and of the page in the log.
    ///
    /// # Errors
    /// [`PageError::Start`] if the system refuses.
    pub fn start(listener: TcpListener, router: Router, name: &'static str) -> Result<Self, PageError> {
        Self::start_with(listener, router, name, PATIENCE)
    }

    fn start_with(
        listener: TcpListener,
        router: Router,
        name: &'static str,
        patience: Duration,
    ) -> Result<Self, PageError> {
        let address = listener.local_addr()?;
        let background = Background::start(name)?;
        background.spawn(async move {
            match tokio::net::TcpListener::from_std(listener) {
                Ok(listener) => accept(listener, router, patience).await,
                Err(error) => tracing::error!("the {name} does not start: {error}"),
            }
        });
        Ok(Self { address, _background: background })
    }

    /// Where it listens.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.address
    }
}

/// A connection, and whether a whole request came over it yet.
struct Held {
    task: AbortHandle,
    asked: Arc<AtomicBool>,
}

/// Takes connections for ever. Where there is no place left, the oldest that has asked nothing yet makes one; where all have,
/// the new one is closed.
async fn accept(listener: tokio::net::TcpListener, router: Router, patience: Duration) {
    let mut tasks = JoinSet::new();
    let mut held: VecDeque<Held> = VecDeque::new();
    loop {
        let stream = match listener.accept().await {
            Ok((stream, _)) => stream,
            // Without descriptors, say: who asks again is heard when there are some.
            Err(error) => {
                tracing::debug!("a connection was not taken: {error}");
                tokio::time::sleep(Duration::from_millis(50)).await;
                continue;
            }
        };
        while tasks.try_join_next().is_some() {}
        held.retain(|held| !held.task.is_finished());
        if held.len() >= CONNECTIONS {
            let Some(silent) = held.iter().position(|held| !held.asked.load(Ordering::Relaxed)) else { continue };
            if let Some(silent) = held.remove(silent) {
                silent.task.abort();
            }
        }
        let asked = Arc::new(AtomicBool::new(false));
        let task = tasks.spawn(answer(stream, router.clone(), patience, Arc::clone(&asked)));
        held.push_back(Held { task, asked });
    }
}

async fn answer(stream: TcpStream, router: Router, patience: Duration, asked: Arc<AtomicBool>) {
    let service = service_fn(move |request: hyper::Request<Incoming>| {
        asked.store(true, Ordering::Relaxed);
        router.clone().call(request.map(Body::new))
    });
    let connection = http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(patience)
        .serve_connection(TokioIo::new(stream), service);
    // Who goes away in the middle of an answer is no error of ours.
    if let Err(error) = connection.await {
        tracing::debug!("a connection ended: {error}");
    }
}

#[cfg(test)]
mod tests {
    use std::{
        io::{Read, Write},
        net::TcpStream,
        time::Instant,
    };

    use axum::routing::get;

    use super::*;

    fn serve(patience: Duration) -> Server {
        let listener = Server::listen("127.0.0.1:0".parse().unwrap()).unwrap();
        let router = Router::new().route("/", get(|| async { "here" }));
        Server::start_with(listener, router, "page", patience).unwrap()
    }

    fn asks(server: &Server) -> String {
        let mut stream = TcpStream::connect(server.address()).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
        stream.write_all(b"GET / HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\n\r\n").unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        answer
    }

    #[test]
    fn who_connects_and_says_nothing_or_half_keeps_nobody_out() {
        let server = serve(PATIENCE);
        let half = |k: usize| {
            let mut stream = TcpStream::connect(server.address()).unwrap();
            // What was closed meanwhile cannot be written to.
            let _ = stream.write_all(if k.is_multiple_of(2) { b"" } else { b"GET / HTTP/1.1\r\nhost: lo" });
            stream
        };
        let silent: Vec<TcpStream> = (0..3 * CONNECTIONS).map(half).collect();
        let begun = Instant::now();
        assert!(asks(&server).contains("here"));
        assert!(begun.elapsed() < PATIENCE, "it waited for those that say nothing");
        // The oldest were closed: each takes a descriptor of the program's.
        let open = silent.iter().filter(|stream| {
            stream.set_nonblocking(true).unwrap();
            matches!((&mut &**stream).read(&mut [0]), Err(error) if error.kind() == io::ErrorKind::WouldBlock)
        });
        assert!(open.count() <= CONNECTIONS);
    }

    #[test]
    fn a_request_that_never_ends_is_given_up() {
        let server = serve(Duration::from_millis(100));
        let mut stream = TcpStream::connect(server.address()).unwrap();
        stream.write_all(b"GET / HTTP/1.1\r\n").unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        let mut answer = Vec::new();
        // The end of the stream, or that it was cut; not that the time for waiting was over.
        let end = stream.read_to_end(&mut answer);
        assert!(!matches!(end, Err(error) if error.kind() == io::ErrorKind::WouldBlock), "it is still waited for");
        assert!(!String::from_utf8_lossy(&answer).contains("200"));
    }

    #[test]
    fn an_address_that_is_taken_is_named() {
        let server = serve(PATIENCE);
        let said = Server::listen(server.address()).unwrap_err().to_string();
        assert!(said.contains(&server.address().to_string()) && said.contains("port 0"), "{said}");
    }
}
