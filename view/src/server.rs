//! Where the page is served, and what the program that holds the runs does for it.

use std::{
    io,
    net::SocketAddr,
    sync::{Arc, Mutex, PoisonError, mpsc},
};

use erfgs_dataset::Dataset;
use erfgs_page::{
    access::{Access, Token},
    serve::Server,
};
use erfgs_scene::image::ImageRgb8;
use erfgs_train::raster::View;
use serde::Serialize;
use tokio::sync::oneshot;

use crate::{
    routes::{self, Site},
    scene_file::SceneFile,
};

/// What is shown of one run.
#[derive(Debug)]
pub struct Model {
    /// What it is called.
    pub name: String,
    /// What it learned.
    pub scene: SceneFile,
    /// What it learned from: its frames are shown beside the renderings.
    pub dataset: Dataset,
}

/// What the page is told of a model before it loads it.
#[derive(Debug, Serialize)]
pub(crate) struct About<'a> {
    name: &'a str,
    bytes: usize,
    only_server: Option<&'a str>,
}

impl<'a> About<'a> {
    pub fn of(name: &'a str, scene: &'a SceneFile) -> Self {
        Self { name, bytes: scene.bytes.len(), only_server: scene.header.only_server.as_deref() }
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

/// How to serve.
#[derive(Clone, Debug)]
pub struct ViewOptions {
    /// Address to listen at; port 0 takes any free one.
    pub address: SocketAddr,
    /// Names that the machine may be called by, besides `localhost` and bare addresses.
    pub names: Vec<String>,
}

/// What keeps the page from being served.
#[derive(Debug, thiserror::Error)]
pub enum ViewError {
    /// The address.
    #[error(
        "cannot serve the view at {address}: {source}. Choose another port with --address, or port 0 for any free one"
    )]
    Listen {
        /// The address.
        address: SocketAddr,
        /// What the system says.
        source: io::Error,
    },
    /// The rest of the system.
    #[error("cannot start the view: {0}")]
    Start(#[from] io::Error),
    /// No random numbers.
    #[error("cannot draw the token of the view: {0}")]
    Token(getrandom::Error),
}

/// A page that is being served; ends when dropped.
#[derive(Debug)]
pub struct ViewPage {
    server: Server,
    access: Arc<Access>,
    compared: Arc<Mutex<Vec<Compared>>>,
}

impl ViewPage {
    /// Starts to serve `models`. What the page wants drawn by the server comes over the channel.
    ///
    /// # Errors
    /// If the address is taken, or the system refuses.
    pub fn serve(models: Vec<Model>, options: &ViewOptions) -> Result<(Self, mpsc::Receiver<Ask>), ViewError> {
        let failed = |source| ViewError::Listen { address: options.address, source };
        let listener = Server::listen(options.address).map_err(failed)?;
        let token = Token::random().map_err(ViewError::Token)?;
        let access = Arc::new(Access { token: Some(token), names: options.names.clone() });
        let (asks, asked) = mpsc::channel();
        let compared = Arc::new(Mutex::new(Vec::new()));
        let site = Site { models, asks, compared: Arc::clone(&compared), access: Arc::clone(&access) };
        let server = Server::start(listener, routes::router(Arc::new(site)), "view")?;
        Ok((Self { server, access, compared }, asked))
    }

    /// Where it listens.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.server.address()
    }

    /// The address to open, with the token.
    #[must_use]
    pub fn url(&self) -> String {
        self.access.url(self.address())
    }

    /// How pictures that browsers drew differed from those of the server, as far as pages have compared any.
    #[must_use]
    pub fn compared(&self) -> Vec<Compared> {
        self.compared.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}
