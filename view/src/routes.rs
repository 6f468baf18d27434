//! What the server answers.

use std::sync::{Arc, Mutex, PoisonError, mpsc};

use axum::{
    Json, Router,
    body::Bytes,
    extract::{DefaultBodyLimit, Path, Query, State},
    http::{StatusCode, header},
    response::{IntoResponse, Response},
    routing::{get, post},
};
use erfgs_page::access::{Access, guarded};
use erfgs_scene::image::{ImageRgb8, jpeg};
use erfgs_splat::raster::View;
use erfgs_train::metrics::{Picture, psnr, to_unit};
use serde::{Deserialize, Serialize};
use tokio::sync::oneshot;

use crate::{
    recorded::Recorded,
    scene_file::SceneFile,
    server::{About, Ask, Compared, Shown},
    texts,
    training::{LiveTraining, TrainingState},
};

/// What is answered where nothing is being trained.
const NO_TRAINING: &str = "nothing is being trained here";

/// The largest picture that is drawn for a page.
const LARGEST_PIXELS: u32 = 4096 * 2304;
/// Quality of the pictures that the server draws.
const JPEG_QUALITY: u8 = 90;
/// What is said of pictures that are equal, dB.
const EQUAL_DB: f64 = 99.0;
/// Comparisons that are kept.
const MOST_COMPARED: usize = 1000;

/// What the routes share.
#[derive(Debug)]
pub(crate) struct Site {
    pub models: Vec<Shown>,
    pub asks: mpsc::Sender<Ask>,
    pub compared: Mutex<Vec<Compared>>,
    pub access: Arc<Access>,
    pub training: Option<Arc<LiveTraining>>,
}

type Shared = State<Arc<Site>>;

pub(crate) fn router(site: Arc<Site>) -> Router {
    let access = Arc::clone(&site.access);
    let router = Router::new()
        .route("/", get(|| async { ([(header::CONTENT_TYPE, "text/html; charset=utf-8")], texts::INDEX) }))
        .route("/file/{*path}", get(file))
        .route("/api/models", get(models))
        .route("/api/scene/{model}", get(scene))
        .route("/api/frame/{model}/{camera}/{index}", get(frame))
        .route("/api/events/{model}/{camera}", get(events))
        .route("/api/errors/{model}", get(errors))
        .route("/api/render/{model}", get(render))
        .route("/api/compare/{model}", post(compare))
        .route("/api/training", get(training))
        .route("/api/training/{wish}", post(wish))
        .layer(DefaultBodyLimit::max(4 * LARGEST_PIXELS as usize))
        .with_state(site);
    guarded(router, access)
}

fn missing(what: &str) -> Response {
    (StatusCode::NOT_FOUND, what.to_owned()).into_response()
}

async fn file(Path(path): Path<String>) -> Response {
    match texts::file(&path) {
        Some((kind, text)) => ([(header::CONTENT_TYPE, kind)], text).into_response(),
        None => missing("the page has no file of that name"),
    }
}

async fn models(State(site): Shared) -> Response {
    let about = |(index, model): (usize, &Shown)| {
        let is_trained = index == 0 && site.training.is_some();
        About::of(&model.name, &model.scene().1, model.window.as_ref(), model.recorded.is_some(), is_trained)
    };
    Json(site.models.iter().enumerate().map(about).collect::<Vec<_>>()).into_response()
}

/// The bytes of a scene that may be replaced while they are sent.
struct SceneBytes(Arc<SceneFile>);

impl AsRef<[u8]> for SceneBytes {
    fn as_ref(&self) -> &[u8] {
        &self.0.bytes
    }
}

async fn scene(State(site): Shared, Path(model): Path<usize>) -> Response {
    match site.models.get(model) {
        Some(model) => {
            let kind = (header::CONTENT_TYPE, "application/octet-stream");
            // Not a copy for everybody who loads it.
            ([kind], Bytes::from_owner(SceneBytes(model.scene().1))).into_response()
        }
        None => missing("there is no such model"),
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Since {
    /// Rows of the curve that the page has.
    #[serde(default)]
    rows: usize,
}

#[derive(Serialize)]
struct Trained {
    /// How many scenes stood before the present one.
    version: u64,
    #[serde(flatten)]
    state: TrainingState,
}

async fn training(State(site): Shared, Query(since): Query<Since>) -> Response {
    let (Some(training), Some(model)) = (&site.training, site.models.first()) else { return missing(NO_TRAINING) };
    Json(Trained { version: model.scene().0, state: training.since(since.rows) }).into_response()
}

async fn wish(State(site): Shared, Path(wish): Path<String>) -> Response {
    let Some(training) = &site.training else { return missing(NO_TRAINING) };
    match wish.as_str() {
        "save" => training.wish_checkpoint(),
        "stop" => training.wish_stop(),
        _ => return missing("a training can save or stop"),
    }
    StatusCode::ACCEPTED.into_response()
}

fn recorded(site: &Site, model: usize) -> Option<Arc<Recorded>> {
    site.models.get(model)?.recorded.clone()
}

/// A recorded frame, by the number that its camera gives it.
async fn frame(State(site): Shared, Path((model, camera, index)): Path<(usize, String, usize)>) -> Response {
    let Some(recorded) = recorded(&site, model) else { return missing("there is no such frame") };
    // A disk may take its time, which is not that of others who look at the page.
    let read = tokio::task::spawn_blocking(move || recorded.frame(&camera, index)).await;
    match read.map_err(|error| error.to_string()).flatten() {
        Ok(bytes) => ([(header::CONTENT_TYPE, "image/png")], bytes).into_response(),
        Err(why) => missing(&why),
    }
}

/// A range of time, shares of the recording.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Range {
    from: f64,
    to: f64,
}

async fn events(
    State(site): Shared,
    Path((model, camera)): Path<(usize, String)>,
    Query(Range { from, to }): Query<Range>,
) -> Response {
    let Some(recorded) = recorded(&site, model) else { return missing("there are no such events") };
    if !from.is_finite() || !to.is_finite() {
        return (StatusCode::BAD_REQUEST, "the range of time is none").into_response();
    }
    // The first look at a camera reads all of its events.
    let read = tokio::task::spawn_blocking(move || recorded.events(&camera, [from, to])).await;
    match read.map_err(|error| error.to_string()).flatten() {
        Ok(bytes) => ([(header::CONTENT_TYPE, "application/octet-stream")], bytes).into_response(),
        Err(why) => missing(&why),
    }
}

async fn errors(State(site): Shared, Path(model): Path<usize>) -> Response {
    match site.models.get(model) {
        Some(model) => Json(&model.errors).into_response(),
        None => missing("there is no such model"),
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Wanted {
    /// When, in [0, 1].
    t01: f64,
    /// A [`View`] as JSON.
    view: String,
    /// The camera's name, for who compares.
    #[serde(default)]
    camera: String,
    /// How the page drew it.
    #[serde(default)]
    mode: String,
}

/// A picture as the server draws it.
async fn drawn(site: &Site, model: usize, wanted: &Wanted) -> Result<ImageRgb8, (StatusCode, String)> {
    let refused = |what: String| (StatusCode::BAD_REQUEST, what);
    let view: View =
        serde_json::from_str(&wanted.view).map_err(|error| refused(format!("the view does not parse: {error}")))?;
    if model >= site.models.len() {
        return Err((StatusCode::NOT_FOUND, "there is no such model".into()));
    }
    if u64::from(view.width) * u64::from(view.height) > u64::from(LARGEST_PIXELS) || !(0.0..=1.0).contains(&wanted.t01)
    {
        return Err(refused("the picture is too large, or its time is not within the recording".into()));
    }
    let (answer, picture) = oneshot::channel();
    let gone = |_| (StatusCode::SERVICE_UNAVAILABLE, "the program is ending".to_owned());
    site.asks.send(Ask { model, view, t01: wanted.t01, answer }).map_err(|error| gone(error.to_string()))?;
    picture.await.map_err(|error| gone(error.to_string()))?.map_err(refused)
}

async fn render(State(site): Shared, Path(model): Path<usize>, Query(wanted): Query<Wanted>) -> Response {
    let picture = match drawn(&site, model, &wanted).await {
        Ok(picture) => picture,
        Err(refused) => return refused.into_response(),
    };
    let packed = move || jpeg(&picture.data, picture.width, picture.height, JPEG_QUALITY);
    match tokio::task::spawn_blocking(packed).await.ok().flatten() {
        Some(bytes) => ([(header::CONTENT_TYPE, "image/jpeg")], bytes).into_response(),
        None => (StatusCode::INTERNAL_SERVER_ERROR, "the picture has no pixels").into_response(),
    }
}

/// Compares what a page drew (RGBA, row by row) with what the server draws.
async fn compare(State(site): Shared, Path(model): Path<usize>, Query(wanted): Query<Wanted>, body: Bytes) -> Response {
    let picture = match drawn(&site, model, &wanted).await {
        Ok(picture) => picture,
        Err(refused) => return refused.into_response(),
    };
    let pixels = body.as_chunks::<4>().0;
    if pixels.len() * 3 != picture.data.len() {
        return (StatusCode::BAD_REQUEST, "the picture has another size than its view").into_response();
    }
    let shown: Vec<u8> = pixels.iter().flat_map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect();
    let worst = shown.iter().zip(&picture.data).map(|(a, b)| a.abs_diff(*b)).max().unwrap_or(0);
    let (shown, drawn) = (to_unit(&shown), to_unit(&picture.data));
    let [shown, drawn] = [&shown, &drawn].map(|rgb| Picture::new(picture.width, picture.height, rgb));
    let psnr_db = match shown.and_then(|shown| psnr(shown, drawn?)) {
        Ok(decibels) => decibels.min(EQUAL_DB),
        Err(error) => return (StatusCode::BAD_REQUEST, error.to_string()).into_response(),
    };
    let compared = Compared { camera: wanted.camera, t01: wanted.t01, mode: wanted.mode, psnr_db, worst };
    let mut kept = site.compared.lock().unwrap_or_else(PoisonError::into_inner);
    if kept.len() < MOST_COMPARED {
        kept.push(compared.clone());
    }
    Json(compared).into_response()
}
