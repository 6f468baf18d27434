//! Asks the live page of another host, within a time and a size.

use std::{io, time::Duration};

use axum::{
    body::{Body, Bytes, to_bytes},
    http::{Method, Request, StatusCode, header},
};
use hyper::client::conn::http1;
use hyper_util::rt::TokioIo;
use tokio::{net::TcpStream, time::timeout};

use super::{error::HostError, link::HostLink};

/// Until there is a connection.
const CONNECT: Duration = Duration::from_secs(3);

/// What was answered.
pub(super) struct Answer {
    pub code: StatusCode,
    pub kind: String,
    pub body: Bytes,
}

/// How long an answer may be.
#[derive(Clone, Copy, Debug)]
pub(super) enum Longest {
    /// A status of many streams with its messages, or what an order came to.
    Words,
    /// Pictures, too.
    Pictures,
}

impl Longest {
    const fn bytes(self) -> usize {
        match self {
            Self::Words => 1 << 20,
            Self::Pictures => 8 << 20,
        }
    }
}

/// Asks for `path`, with `json` where something is to be done, and waits so long for an answer that is no longer than `longest`.
pub(super) async fn ask(
    link: &HostLink,
    path: &str,
    json: Option<String>,
    patience: Duration,
    longest: Longest,
) -> Result<Answer, HostError> {
    let host = || link.name();
    let unreachable = |source| HostError::Unreachable { host: host(), source };
    let late = || io::Error::new(io::ErrorKind::TimedOut, "no connection within 3 s");
    let stream = match timeout(CONNECT, TcpStream::connect(link.to_connect())).await {
        Ok(connected) => connected.map_err(unreachable)?,
        Err(_) => return Err(unreachable(late())),
    };
    // The address that was connected to: a page answers to those, whatever its host is called.
    let at = stream.peer_addr().map_err(unreachable)?;
    let mut request = Request::builder()
        .method(if json.is_some() { Method::POST } else { Method::GET })
        .uri(path)
        .header(header::HOST, at.to_string())
        .header(header::CONNECTION, "close");
    if let Some(token) = link.token() {
        request = request.header(header::AUTHORIZATION, format!("Bearer {}", token.reveal()));
    }
    if json.is_some() {
        request = request.header(header::CONTENT_TYPE, "application/json");
    }
    let request = request.body(json.map_or_else(Body::empty, Body::from));
    let silent = |what: String| HostError::Silent { host: host(), what };
    let request = request.map_err(|error| silent(error.to_string()))?;
    let asked = async {
        let (mut sender, connection) = http1::handshake(TokioIo::new(stream)).await?;
        let _ends_with_us = Ends(tokio::spawn(connection).abort_handle());
        let (head, body) = sender.send_request(request).await?.into_parts();
        let body = to_bytes(Body::new(body), longest.bytes()).await;
        Ok::<_, hyper::Error>((head, body))
    };
    let (head, body) = match timeout(patience, asked).await {
        Err(_) => return Err(silent(format!("nothing within {} s", patience.as_secs()))),
        Ok(Err(error)) if error.is_parse() => {
            return Err(HostError::Foreign { host: host(), what: "it does not speak HTTP".into() });
        }
        Ok(Err(error)) => return Err(silent(error.to_string())),
        Ok(Ok(answer)) => answer,
    };
    let body = body.map_err(|error| silent(error.to_string()))?;
    if head.status == StatusCode::UNAUTHORIZED {
        return Err(HostError::Token { host: host() });
    }
    let kind = head.headers.get(header::CONTENT_TYPE).and_then(|kind| kind.to_str().ok()).unwrap_or_default();
    Ok(Answer { code: head.status, kind: kind.to_owned(), body })
}

/// A connection that is of no more use to anybody.
struct Ends(tokio::task::AbortHandle);

impl Drop for Ends {
    fn drop(&mut self) {
        self.0.abort();
    }
}
