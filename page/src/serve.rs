//! A server of pages: a thread with a single-threaded runtime, which ends when it is dropped.
//!
//! Who connects and asks nothing, or may not see the page, takes a place only for a while: connections are bounded in number, those of
//! who was admitted are kept before all others, and a request must be whole in time, with what it brings. So many descriptors are the most that a page takes from the program that it belongs to.

use std::{
    collections::VecDeque,
    io,
    net::{SocketAddr, TcpListener},
    pin::Pin,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering::Relaxed},
    },
    task::{Context, Poll},
    time::Duration,
};

use axum::{BoxError, Router, body::Body};
use hyper::{
    body::{Bytes, Frame, Incoming, SizeHint},
    server::conn::http1,
    service::service_fn,
};
use hyper_util::rt::{TokioIo, TokioTimer};
use tokio::{
    net::TcpStream,
    task::{AbortHandle, JoinSet},
    time::{Sleep, sleep},
};
use tower_service::Service;

use crate::{access::Admitted, background::Background};

/// How long a connection may take until its next request is whole.
const PATIENCE: Duration = Duration::from_secs(10);
/// For how many times as long what a request brings may take, once its head is there: a picture over a slow network.
const BODY: u32 = 3;
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

/// A connection, and whether a request came over it yet of somebody who may see the page.
struct Held {
    task: AbortHandle,
    admitted: Admitted,
    /// Whether a request is there that did not bring all of it yet.
    bringing: Arc<AtomicBool>,
}

/// Takes connections for ever. Where there is no place left, the oldest over which nobody was admitted yet makes one; where there is
/// none of these, the oldest whose request did not bring all of it yet; and where there is none of these, the new one is closed.
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
            let silent = held.iter().position(|held| !held.admitted.is_so());
            let least = silent.or_else(|| held.iter().position(|held| held.bringing.load(Relaxed)));
            let Some(least) = least.and_then(|at| held.remove(at)) else { continue };
            least.task.abort();
        }
        let admitted = Admitted::default();
        let bringing = Arc::new(AtomicBool::new(false));
        let task = tasks.spawn(answer(stream, router.clone(), patience, (admitted.clone(), Arc::clone(&bringing))));
        held.push_back(Held { task, admitted, bringing });
    }
}

async fn answer(
    stream: TcpStream,
    router: Router,
    patience: Duration,
    (admitted, bringing): (Admitted, Arc<AtomicBool>),
) {
    let in_time = BODY * patience;
    let service = service_fn(move |mut request: hyper::Request<Incoming>| {
        request.extensions_mut().insert(admitted.clone());
        let bringing = Arc::clone(&bringing);
        router.clone().call(request.map(|body| {
            bringing.store(!hyper::body::Body::is_end_stream(&body), Relaxed);
            Body::new(InTime { body, until: Box::pin(sleep(in_time)), bringing })
        }))
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

/// What a request brings, which has to be there in time.
struct InTime {
    body: Incoming,
    until: Pin<Box<Sleep>>,
    /// Not for longer than this lives: who was answered has brought what was wanted.
    bringing: Arc<AtomicBool>,
}

impl Drop for InTime {
    fn drop(&mut self) {
        self.bringing.store(false, Relaxed);
    }
}

impl hyper::body::Body for InTime {
    type Data = Bytes;
    type Error = BoxError;

    fn poll_frame(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Option<Result<Frame<Bytes>, BoxError>>> {
        // What is there is taken, however late it is looked at.
        match Pin::new(&mut self.body).poll_frame(context) {
            Poll::Ready(frame) => Poll::Ready(frame.map(|frame| frame.map_err(Into::into))),
            Poll::Pending => match self.until.as_mut().poll(context) {
                Poll::Ready(()) => Poll::Ready(Some(Err("the request did not bring all of it in time".into()))),
                Poll::Pending => Poll::Pending,
            },
        }
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}

#[cfg(test)]
mod tests {
    use std::{
        io::{Read, Write},
        net::TcpStream,
        time::Instant,
    };

    use axum::routing::{get, post};

    use super::*;
    use crate::access::{Access, guarded};

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

    /// A page with a token, and the token.
    fn serve_guarded(patience: Duration) -> (Server, String) {
        let listener = Server::listen("127.0.0.1:0".parse().unwrap()).unwrap();
        let options = PageOptions { address: listener.local_addr().unwrap(), names: Vec::new(), open: false };
        let access = Arc::new(Access::new(&options).unwrap());
        let token = access.token.as_ref().unwrap().reveal().to_owned();
        let router = Router::new()
            .route("/", get(|| async { "here" }))
            .route("/body", post(|body: Bytes| async move { body.len().to_string() }));
        (Server::start_with(listener, guarded(router, access), "page", patience).unwrap(), token)
    }

    fn says(stream: &mut TcpStream, head: &str) -> String {
        stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        // What was closed meanwhile cannot be written to.
        let _ = stream.write_all(format!("{head}\r\nhost: localhost\r\n\r\n").as_bytes());
        let mut answer = String::new();
        let _ = stream.read_to_string(&mut answer);
        answer
    }

    #[test]
    fn who_is_refused_is_let_go() {
        let (server, _) = serve_guarded(Duration::from_secs(3600));
        let mut stream = TcpStream::connect(server.address()).unwrap();
        // Read to its end: the connection is closed, though HTTP 1.1 keeps them.
        let answer = says(&mut stream, "GET / HTTP/1.1");
        assert!(answer.contains("401") && answer.to_lowercase().contains("connection: close"), "{answer}");
    }

    #[test]
    fn who_has_no_token_keeps_nobody_out_who_has() {
        let (server, token) = serve_guarded(Duration::from_secs(3600));
        let admitted = format!("GET / HTTP/1.1\r\nauthorization: Bearer {token}");
        let mut first = TcpStream::connect(server.address()).unwrap();
        first.write_all(format!("{admitted}\r\nhost: localhost\r\n\r\n").as_bytes()).unwrap();
        first.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        assert!(first.read(&mut [0; 1024]).unwrap() > 0);
        // They ask for something, and begin to ask for more.
        let greedy: Vec<TcpStream> = (0..3 * CONNECTIONS)
            .map(|_| {
                let mut stream = TcpStream::connect(server.address()).unwrap();
                let _ = stream.write_all(b"GET / HTTP/1.1\r\nhost: localhost\r\n\r\nGET / HTTP/1.1\r\n");
                stream
            })
            .collect();
        let mut stream = TcpStream::connect(server.address()).unwrap();
        let answer = says(&mut stream, &format!("{admitted}\r\nconnection: close"));
        assert!(answer.contains("here"), "{answer}");
        // Who was admitted before them was not sent away, either.
        assert!(says(&mut first, &format!("{admitted}\r\nconnection: close")).contains("here"));
        drop(greedy);
    }

    #[test]
    fn requests_that_do_not_bring_what_they_announce_keep_nobody_out() {
        let (server, token) = serve_guarded(Duration::from_secs(3600));
        let bearer = format!("authorization: Bearer {token}");
        let slow: Vec<TcpStream> = (0..3 * CONNECTIONS)
            .map(|_| {
                let mut stream = TcpStream::connect(server.address()).unwrap();
                let head =
                    format!("POST /body HTTP/1.1\r\n{bearer}\r\nhost: localhost\r\ncontent-length: 5\r\n\r\nhalf");
                let _ = stream.write_all(head.as_bytes());
                stream
            })
            .collect();
        let mut stream = TcpStream::connect(server.address()).unwrap();
        let answer = says(&mut stream, &format!("GET / HTTP/1.1\r\n{bearer}\r\nconnection: close"));
        assert!(answer.contains("here"), "{answer}");
        drop(slow);
    }

    #[test]
    fn what_a_request_brings_has_to_be_there_in_time() {
        let (server, token) = serve_guarded(Duration::from_millis(300));
        let mut stream = TcpStream::connect(server.address()).unwrap();
        let head = format!("POST /body HTTP/1.1\r\nauthorization: Bearer {token}\r\ncontent-length: 5");
        // Never sent: it is answered, and the connection closed.
        let answer = says(&mut stream, &head);
        assert!(answer.contains("400"), "{answer}");
    }

    #[test]
    fn a_code_leads_to_the_page_once() {
        let listener = Server::listen("127.0.0.1:0".parse().unwrap()).unwrap();
        let address = listener.local_addr().unwrap();
        let access = Arc::new(Access::new(&PageOptions { address, names: Vec::new(), open: false }).unwrap());
        let url = access.url_for_once(address).unwrap();
        let router = guarded(Router::new().route("/", get(|| async { "here" })), access);
        let _server = Server::start_with(listener, router, "page", PATIENCE).unwrap();
        let path = &url[url.rfind('/').unwrap()..];
        let ask = |head: &str| says(&mut TcpStream::connect(address).unwrap(), &format!("{head}\r\nconnection: close"));
        let answer = ask(&format!("GET {path} HTTP/1.1"));
        assert!(answer.starts_with("HTTP/1.1 200"), "{answer}");
        let part =
            |before: &str, after: char| answer.split_once(before).unwrap().1.split(after).next().unwrap().to_owned();
        let (place, cookie) = (part("url=", '"'), part("set-cookie: ", ';'));
        assert!(ask(&format!("GET {place} HTTP/1.1\r\ncookie: {cookie}")).contains("here"));
        assert!(ask(&format!("GET {place} HTTP/1.1")).contains("401"), "the path alone opens nothing");
        assert!(ask(&format!("GET {path} HTTP/1.1")).contains("401"), "a code was taken twice");
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
        let message = Server::listen(server.address()).unwrap_err().to_string();
        assert!(message.contains(&server.address().to_string()) && message.contains("port 0"), "{message}");
    }
}
