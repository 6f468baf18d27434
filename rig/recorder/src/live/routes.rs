//! What the server answers.

use std::{
    convert::Infallible,
    fs::File,
    io::Read,
    path::PathBuf,
    sync::{Arc, OnceLock},
    time::Duration,
};

use axum::{
    Json, Router,
    body::{Body, Bytes},
    extract::{DefaultBodyLimit, Path, Query, State},
    http::{StatusCode, Uri, header},
    response::{
        IntoResponse, Response, Sse,
        sse::{Event, KeepAlive},
    },
    routing::{get, post},
};
use erfgs_page::access::{Access, guarded};
use futures_util::stream;
use serde::{Deserialize, Serialize};

use super::{
    guide::Guidance,
    monitor::{Look, Monitor},
    playback::{Playback, PlaybackOrder, PlaybackStatus},
};
use crate::{
    AdjustError, Level, RecordError, Recorder, SinkError, Status,
    hosts::{HostView, Hosts, StartError},
    names::{self, NameError},
};

/// Between two sets of numbers.
const TICK: Duration = Duration::from_millis(250);
/// Bytes of a download that are read at once.
const PIECE: usize = 1 << 20;

/// What the routes share.
pub(super) struct Site {
    pub recorder: Arc<Recorder>,
    pub monitor: Arc<Monitor>,
    pub access: Arc<Access>,
    pub playback: OnceLock<Arc<dyn Playback>>,
    /// Other hosts that record with this one.
    pub hosts: OnceLock<Arc<Hosts>>,
}

type Shared = State<Arc<Site>>;

pub(super) fn router(site: Arc<Site>) -> Router {
    let access = Arc::clone(&site.access);
    let router = Router::new()
        .route("/", get(|| async { page("text/html; charset=utf-8", include_str!("page/index.html")) }))
        .route("/style.css", get(|| async { page("text/css; charset=utf-8", include_str!("page/style.css")) }))
        .route("/page.js", get(|| async { page("text/javascript; charset=utf-8", include_str!("page/page.js")) }))
        .route(
            "/playback.js",
            get(|| async { page("text/javascript; charset=utf-8", include_str!("page/playback.js")) }),
        )
        .route(
            "/settings.js",
            get(|| async { page("text/javascript; charset=utf-8", include_str!("page/settings.js")) }),
        )
        .route("/api/status", get(status))
        .route("/api/stream", get(numbers))
        .route("/api/preview/{id}", get(preview))
        .route("/api/recordings", get(list))
        .route("/api/start", post(start))
        .route("/api/stop", post(stop))
        .route("/api/keep", post(keep))
        .route("/api/playback", post(playback))
        .route("/api/span", post(span))
        .route("/api/read", post(read))
        .route("/api/knobs/{id}", get(knobs))
        .route("/api/adjust", post(adjust))
        .route("/api/keep-settings", post(keep_settings))
        .route("/api/hosts/{host}/{*what}", get(of_host).post(order_host))
        .route("/recordings/{name}", get(download))
        .layer(DefaultBodyLimit::max(4096))
        .with_state(site);
    guarded(router, access)
}

fn page(kind: &'static str, text: &'static str) -> impl IntoResponse {
    ([(header::CONTENT_TYPE, kind)], text)
}

/// What the page shows.
#[derive(Serialize)]
struct Numbers<'a> {
    status: &'a Status,
    looks: Vec<Look>,
    guidance: Vec<Guidance>,
    folder: String,
    /// Pictures of events show the last so many microseconds.
    span_us: u64,
    playback: Option<PlaybackStatus>,
    hosts: Vec<HostView>,
}

fn numbers_now(site: &Site) -> String {
    let status = site.recorder.status();
    // Whole, for somebody on another host.
    let folder = site.recorder.folder();
    let folder = std::path::absolute(folder).unwrap_or_else(|_| folder.to_owned()).display().to_string();
    let numbers = Numbers {
        status: &status,
        looks: site.monitor.looks(),
        guidance: site.monitor.guidance(),
        folder,
        span_us: site.monitor.span_us(),
        playback: site.playback.get().map(|playback| playback.status()),
        hosts: site.hosts.get().map(|hosts| hosts.views()).unwrap_or_default(),
    };
    serde_json::to_string(&numbers).unwrap_or_default()
}

async fn status(State(site): Shared) -> impl IntoResponse {
    ([(header::CONTENT_TYPE, "application/json")], numbers_now(&site))
}

async fn numbers(State(site): Shared) -> impl IntoResponse {
    let events = stream::unfold((site, false), |(site, waited)| async move {
        if waited {
            tokio::time::sleep(TICK).await;
        }
        let event = Event::default().data(numbers_now(&site));
        Some((Ok::<_, Infallible>(event), (site, true)))
    });
    Sse::new(events).keep_alive(KeepAlive::default())
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Size {
    /// Whether the camera is enlarged.
    #[serde(default)]
    large: bool,
}

async fn preview(State(site): Shared, Path(id): Path<String>, Query(Size { large }): Query<Size>) -> Response {
    match site.monitor.preview(&id, large) {
        Some(jpeg) => ([(header::CONTENT_TYPE, "image/jpeg")], Bytes::from(jpeg)).into_response(),
        None => (StatusCode::NOT_FOUND, "there is no picture of that name yet").into_response(),
    }
}

async fn list(State(site): Shared) -> Response {
    match names::recordings(site.recorder.folder()) {
        Ok(found) => Json(found).into_response(),
        Err(error) => (StatusCode::INTERNAL_SERVER_ERROR, format!("cannot list the folder: {error}")).into_response(),
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Start {
    /// Name of the recording; empty for one made of the rig's name and the time.
    #[serde(default)]
    name: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Stop {}

async fn start(State(site): Shared, Json(asked): Json<Start>) -> Response {
    let rig = site.recorder.status().rig.clone();
    let path = match names::new(site.recorder.folder(), &asked.name, &rig, std::time::SystemTime::now()) {
        Ok(path) => path,
        Err(error) => return refuse(StatusCode::BAD_REQUEST, &error.to_string()),
    };
    let started = blocking(move || match site.hosts.get() {
        Some(hosts) => hosts.start(&site.recorder, &path, None),
        None => Ok(site.recorder.start_recording(&path)?),
    });
    match started.await {
        Some(Ok(())) => Json(serde_json::json!({ "started": true })).into_response(),
        Some(Err(error @ StartError::Own(RecordError::Busy(_) | RecordError::Sink(SinkError::Exists(_))))) => {
            refuse(StatusCode::CONFLICT, &error.to_string())
        }
        Some(Err(error @ StartError::Host { .. })) => refuse(StatusCode::BAD_GATEWAY, &error.to_string()),
        Some(Err(error)) => refuse(StatusCode::INTERNAL_SERVER_ERROR, &error.to_string()),
        None => refuse(StatusCode::INTERNAL_SERVER_ERROR, "the recorder failed: see the terminal"),
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Keep {}

/// Keeps what is held of the past.
async fn keep(State(site): Shared, Json(Keep {}): Json<Keep>) -> Response {
    let kept = blocking(move || site.recorder.keep_past(site.recorder.after())).await;
    match kept {
        Some(Ok(path)) => Json(serde_json::json!({ "path": path })).into_response(),
        Some(Err(error @ RecordError::Busy(_))) => refuse(StatusCode::CONFLICT, &error.to_string()),
        Some(Err(error)) => refuse(StatusCode::INTERNAL_SERVER_ERROR, &error.to_string()),
        None => refuse(StatusCode::INTERNAL_SERVER_ERROR, "the recorder failed: see the terminal"),
    }
}

async fn stop(State(site): Shared, Json(Stop {}): Json<Stop>) -> Response {
    let stopped = blocking(move || {
        let reason = "stopped from the live page";
        let stopped = match site.hosts.get() {
            Some(hosts) => hosts.stop(&site.recorder, reason),
            None => site.recorder.stop_recording(reason),
        };
        if stopped.is_err() {
            site.recorder.say(Level::Info, "", "asked to stop, but no recording runs");
        }
        stopped
    });
    match stopped.await {
        Some(Ok(summary)) => Json(summary).into_response(),
        Some(Err(error)) => refuse(StatusCode::CONFLICT, &error.to_string()),
        None => refuse(StatusCode::INTERNAL_SERVER_ERROR, "the recorder failed: see the terminal"),
    }
}

async fn playback(State(site): Shared, Json(order): Json<PlaybackOrder>) -> Response {
    let Some(playback) = site.playback.get() else {
        return refuse(StatusCode::CONFLICT, "no recording is played here: these are cameras");
    };
    match playback.order(&order) {
        Ok(()) => Json(playback.status()).into_response(),
        Err(why) => refuse(StatusCode::BAD_REQUEST, &why),
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Span {
    us: u64,
}

async fn span(State(site): Shared, Json(Span { us }): Json<Span>) -> Response {
    site.monitor.show_span_us(us);
    Json(serde_json::json!({ "us": site.monitor.span_us() })).into_response()
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct WasRead {
    /// Number of the message.
    number: u64,
}

async fn read(State(site): Shared, Json(WasRead { number }): Json<WasRead>) -> Response {
    site.recorder.mark_read(number);
    Json(serde_json::json!({ "read": number })).into_response()
}

async fn knobs(State(site): Shared, Path(id): Path<String>) -> Response {
    answered(blocking(move || site.recorder.knobs(&id)).await)
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Adjust {
    stream: String,
    changed: serde_json::Map<String, serde_json::Value>,
}

async fn adjust(State(site): Shared, Json(Adjust { stream, changed }): Json<Adjust>) -> Response {
    answered(blocking(move || site.recorder.adjust(&stream, &changed)).await)
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct KeepSettings {
    stream: String,
}

async fn keep_settings(State(site): Shared, Json(KeepSettings { stream }): Json<KeepSettings>) -> Response {
    answered(blocking(move || site.recorder.keep_settings(&stream)).await)
}

fn answered<T: Serialize>(answer: Option<Result<T, AdjustError>>) -> Response {
    match answer {
        Some(Ok(answer)) => Json(answer).into_response(),
        Some(Err(error @ AdjustError::Unknown(_))) => refuse(StatusCode::NOT_FOUND, &error.to_string()),
        Some(Err(error)) => refuse(StatusCode::BAD_REQUEST, &error.to_string()),
        None => refuse(StatusCode::INTERNAL_SERVER_ERROR, "the recorder failed: see the terminal"),
    }
}

/// Pictures and settings of cameras of another host, as it answers.
async fn of_host(State(site): Shared, Path((host, what)): Path<(usize, String)>, uri: Uri) -> Response {
    let id = what.strip_prefix("preview/").or_else(|| what.strip_prefix("knobs/"));
    if !id.is_some_and(crate::is_id) {
        return refuse(StatusCode::NOT_FOUND, "other hosts have no such command");
    }
    let large = uri.query().is_some_and(|query| query.split('&').any(|part| part == "large=true"));
    relay(&site, host, format!("/api/{what}{}", if large { "?large=true" } else { "" }), None).await
}

/// Lets another host change the settings of its cameras, or what its pictures show.
async fn order_host(
    State(site): Shared,
    Path((host, what)): Path<(usize, String)>,
    Json(json): Json<serde_json::Value>,
) -> Response {
    if !matches!(what.as_str(), "adjust" | "keep-settings" | "span") {
        return refuse(StatusCode::NOT_FOUND, "other hosts have no such command");
    }
    relay(&site, host, format!("/api/{what}"), Some(json.to_string())).await
}

async fn relay(site: &Site, host: usize, path: String, json: Option<String>) -> Response {
    let Some(hosts) = site.hosts.get() else { return refuse(StatusCode::NOT_FOUND, "there are no other hosts") };
    match hosts.relay(host, &path, json).await {
        // A kind of its own choice could make a browser run what it says.
        Some(Ok((code, kind, body))) => {
            let kind = ["image/jpeg", "application/json"].into_iter().find(|known| kind == *known);
            (code, [(header::CONTENT_TYPE, kind.unwrap_or("text/plain; charset=utf-8"))], body).into_response()
        }
        Some(Err(error)) => refuse(StatusCode::BAD_GATEWAY, &error.to_string()),
        None => refuse(StatusCode::NOT_FOUND, "there is no such host"),
    }
}

fn refuse(code: StatusCode, why: &str) -> Response {
    (code, Json(serde_json::json!({ "error": why }))).into_response()
}

/// Work that may wait for a disk, off the thread that answers.
async fn blocking<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> Option<T> {
    tokio::task::spawn_blocking(work).await.ok()
}

async fn download(State(site): Shared, Path(name): Path<String>) -> Response {
    let path = match names::existing(site.recorder.folder(), &name) {
        Ok(path) => path,
        Err(error @ NameError::Bad(_)) => return (StatusCode::BAD_REQUEST, error.to_string()).into_response(),
        Err(error @ NameError::Absent(_)) => return (StatusCode::NOT_FOUND, error.to_string()).into_response(),
    };
    let Some(Ok((file, length))) = blocking(move || open(&path)).await else {
        return (StatusCode::INTERNAL_SERVER_ERROR, "the recording cannot be read").into_response();
    };
    // A file that grows while it is sent ends where it ended when it was asked for.
    let pieces = stream::try_unfold((file, length), |(mut file, left)| async move {
        if left == 0 {
            return Ok(None);
        }
        let read = tokio::task::spawn_blocking(move || {
            let mut piece = vec![0; PIECE.min(usize::try_from(left).unwrap_or(PIECE))];
            let count = file.read(&mut piece)?;
            piece.truncate(count);
            Ok::<_, std::io::Error>((file, piece))
        });
        let (file, piece) = read.await.map_err(std::io::Error::other)??;
        let left = if piece.is_empty() { 0 } else { left - piece.len() as u64 };
        Ok::<_, std::io::Error>(Some((Bytes::from(piece), (file, left))))
    });
    let headers = [
        (header::CONTENT_TYPE, "application/octet-stream".to_owned()),
        (header::CONTENT_DISPOSITION, format!("attachment; filename=\"{name}\"")),
        (header::CONTENT_LENGTH, length.to_string()),
    ];
    (headers, Body::from_stream(pieces)).into_response()
}

fn open(path: &PathBuf) -> std::io::Result<(File, u64)> {
    let file = File::open(path)?;
    let length = file.metadata()?.len();
    Ok((file, length))
}
