//! Where the page is served, and what the program that holds the runs does for it.

use std::{
    net::SocketAddr,
    sync::{Arc, Mutex, PoisonError, RwLock, mpsc},
};

use erfgs_dataset::Dataset;
use erfgs_page::{
    access::Access,
    serve::{PageError, PageOptions, Server},
};
use erfgs_scene::image::ImageRgb8;
use erfgs_splat::raster::View;
use serde::Serialize;
use tokio::sync::oneshot;

use crate::{
    recorded::Recorded,
    routes::{self, Site},
    scene_file::SceneFile,
    training::LiveTraining,
    window::{AboutWindow, Window},
};

/// What is shown of one run.
#[derive(Debug)]
pub struct Model {
    /// What it is called.
    pub name: String,
    /// What it learned.
    pub scene: SceneFile,
    /// What it learned from: its frames are shown beside the renderings. Of a scene file nobody knows.
    pub dataset: Option<Dataset>,
    /// How well it shows frames of held-out cameras, where that was measured.
    pub errors: Vec<FrameError>,
    /// Which window of a take it is, where the models of a page are such, in their order.
    pub window: Option<Window>,
}

/// How well a frame is shown.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FrameError {
    /// The camera.
    pub camera: String,
    /// When, in [0, 1].
    pub t01: f64,
    /// Peak signal-to-noise ratio, dB.
    pub psnr_db: f64,
}

/// A model that is being served: its scene may be replaced.
#[derive(Debug)]
pub(crate) struct Shown {
    pub name: String,
    pub recorded: Option<Arc<Recorded>>,
    pub errors: Vec<FrameError>,
    pub window: Option<Window>,
    scene: RwLock<(u64, Arc<SceneFile>)>,
}

impl Shown {
    fn new(model: Model) -> Self {
        let Model { name, scene, dataset, errors, window } = model;
        let recorded = dataset.map(|dataset| Arc::new(Recorded::new(dataset)));
        Self { name, recorded, errors, window, scene: RwLock::new((0, Arc::new(scene))) }
    }

    /// The scene, and how many stood before it.
    pub fn scene(&self) -> (u64, Arc<SceneFile>) {
        self.scene.read().unwrap_or_else(PoisonError::into_inner).clone()
    }

    fn replace(&self, scene: SceneFile) {
        let mut shown = self.scene.write().unwrap_or_else(PoisonError::into_inner);
        *shown = (shown.0 + 1, Arc::new(scene));
    }
}

/// What the page is told of a model before it loads it.
#[derive(Debug, Serialize)]
pub(crate) struct About {
    name: String,
    bytes: usize,
    only_server: Option<String>,
    /// Whether the server draws it for browsers that cannot, and has its frames.
    from_run: bool,
    /// Whether it is being trained.
    training: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    window: Option<AboutWindow>,
}

impl About {
    pub fn of(name: &str, scene: &SceneFile, window: Option<&Window>, from_run: bool, training: bool) -> Self {
        let only_server = scene.header.only_server.clone();
        let window = window.map(|window| AboutWindow::of(window, &scene.header));
        Self { name: name.to_owned(), bytes: scene.bytes.len(), only_server, from_run, training, window }
    }
}

/// A picture that a page asks for, to be drawn by who holds the runs.
#[derive(Debug)]
pub struct Ask {
    /// Which of the models.
    pub model: usize,
    /// From where.
    pub view: View,
    /// When, in [0, 1].
    pub t01: f64,
    /// Takes the picture, or why there is none.
    pub answer: oneshot::Sender<Result<ImageRgb8, String>>,
}

impl Ask {
    /// Whether nobody waits for the picture any more.
    #[must_use]
    pub fn is_abandoned(&self) -> bool {
        self.answer.is_closed()
    }
}

/// How a picture that a browser drew differs from the one of the server.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Compared {
    /// The camera.
    pub camera: String,
    /// When, in [0, 1].
    pub t01: f64,
    /// How it was drawn: `tiles` or `quads`.
    pub mode: String,
    /// Peak signal-to-noise ratio, dB; 99 where they are equal.
    pub psnr_db: f64,
    /// The greatest difference, of 255.
    pub worst: u8,
}

/// A page that is being served; ends when dropped.
#[derive(Debug)]
pub struct ViewPage {
    server: Server,
    site: Arc<Site>,
}

impl ViewPage {
    /// Starts to serve `models`, the first of which is being trained where `training` is given. What the page wants drawn by
    /// the server comes over the channel.
    ///
    /// # Errors
    /// [`PageError`] if the address is taken, or the system refuses.
    pub fn serve(
        models: Vec<Model>,
        training: Option<Arc<LiveTraining>>,
        options: &PageOptions,
    ) -> Result<(Self, mpsc::Receiver<Ask>), PageError> {
        let listener = Server::listen(options.address)?;
        let access = Arc::new(Access::new(options)?);
        let (asks, asked) = mpsc::channel();
        let models = models.into_iter().map(Shown::new).collect();
        let site = Arc::new(Site { models, asks, compared: Mutex::default(), access, training });
        let server = Server::start(listener, routes::router(Arc::clone(&site)), "view")?;
        Ok((Self { server, site }, asked))
    }

    /// Shows another scene of a model: it has learned more.
    pub fn replace(&self, model: usize, scene: SceneFile) {
        if let Some(shown) = self.site.models.get(model) {
            shown.replace(scene);
        }
    }

    /// Where it listens.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.server.address()
    }

    /// The address to open, with the token.
    #[must_use]
    pub fn url(&self) -> String {
        self.site.access.url(self.address())
    }

    /// An address that opens the page once, to be handed to a browser.
    ///
    /// # Errors
    /// [`PageError::Token`] if no code can be drawn.
    pub fn url_for_once(&self) -> Result<String, PageError> {
        self.site.access.url_for_once(self.address())
    }

    /// How pictures that browsers drew differed from those of the server, as far as pages have compared any.
    #[must_use]
    pub fn compared(&self) -> Vec<Compared> {
        self.site.compared.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

#[cfg(test)]
mod tests {
    use std::{
        io::Write,
        net::TcpStream,
        time::{Duration, Instant},
    };

    use super::*;

    #[test]
    fn a_picture_that_nobody_waits_for_any_more_is_known() {
        let model =
            Model { name: "a".into(), scene: SceneFile::for_tests(), dataset: None, errors: Vec::new(), window: None };
        let options = PageOptions { address: "127.0.0.1:0".parse().unwrap(), names: Vec::new(), open: true };
        let (page, asks) = ViewPage::serve(vec![model], None, &options).unwrap();
        let rotation = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let view = View { width: 4, height: 4, fx: 4.0, fy: 4.0, cx: 2.0, cy: 2.0, rotation, translation: [0.0; 3] };
        let view = serde_json::to_string(&view).unwrap();
        let view: String = view.bytes().map(|byte| format!("%{byte:02x}")).collect();
        let mut stream = TcpStream::connect(page.address()).unwrap();
        let head = format!("GET /api/render/0?t01=0&view={view} HTTP/1.1\r\nhost: localhost\r\n\r\n");
        stream.write_all(head.as_bytes()).unwrap();
        let ask = asks.recv_timeout(Duration::from_secs(60)).unwrap();
        assert!(!ask.is_abandoned());
        drop(stream);
        let begun = Instant::now();
        while !ask.is_abandoned() {
            assert!(begun.elapsed() < Duration::from_secs(60), "it is still waited for");
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}
