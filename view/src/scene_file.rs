//! What a page needs to know of a run, in one file; `docs/view.md` describes it.
//!
//! The magic `ERFGS4D1`, the length of a JSON header (u32, little-endian), the header, and sections of little-endian f32 in the
//! order that the header lists; the first begins at a multiple of four bytes.

use erfgs_dataset::Split;
use erfgs_train::{
    checkpoint::Checkpoint,
    config::MotionModel,
    field::FieldState,
    raster::View,
    scene::Scene,
    schedule::Stage,
    trainer::{TrainError, Trainer},
};
use serde::Serialize;

/// What a file begins with.
pub const MAGIC: &[u8; 8] = b"ERFGS4D1";
/// Points of the initial cloud that tell how near to a camera there is something to see.
const POINTS: usize = 4000;

/// A scene as bytes, and whether a browser can draw it.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneFile {
    /// The file.
    pub bytes: Vec<u8>,
    /// What is said of it.
    pub header: Header,
}

/// The header of a file.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Header {
    /// Gaussians.
    pub count: usize,
    /// How many of them move; they come first.
    pub dynamic: usize,
    /// SH degree that the rows have room for.
    pub sh_degree: u32,
    /// SH degree in use.
    pub active_sh_degree: u32,
    /// Colour behind everything.
    pub background: [f32; 3],
    /// The least near plane, metres, and the share of the depth of the nearest points at which it lies.
    pub near: [f32; 2],
    /// Standard deviations of a Gaussian that must lie in front of a camera.
    pub near_sigmas: f32,
    /// First and last instant, session nanoseconds.
    pub span_ns: [i64; 2],
    /// How the first rows move.
    pub motion: HeaderMotion,
    /// What of the model a browser's kernels cannot compute, so that the server must draw it.
    pub only_server: Option<String>,
    /// The cameras.
    pub cameras: Vec<HeaderCamera>,
    /// Edges (in [0, 1]) and events (all cameras together) of bins of time.
    pub events: HeaderEvents,
    /// Names and lengths (floats) of the sections.
    pub sections: Vec<(String, usize)>,
}

/// How Gaussians move.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum HeaderMotion {
    /// They do not.
    Still,
    /// Each has a trajectory and a life: section `motion`, eight floats a row.
    FreeTime {
        /// RGB intervals in the span: the unit of time of the rows.
        intervals: f32,
        /// The shortest life, intervals.
        least_life: f32,
        /// The logit change that stands for an opacity of nothing.
        gone: f32,
    },
    /// A deformation field: sections named as in a checkpoint.
    Hexplane {
        /// The box of the planes, metres.
        aabb: [[f32; 3]; 2],
        /// Multipliers of the spatial resolution.
        levels: Vec<u32>,
        /// Features of a plane.
        features: u32,
        /// Width of the network.
        width: u32,
        /// Cells along each axis at multiplier 1.
        spatial_resolution: u32,
        /// Whether [0, 1] falls on the upper half of the rows of time.
        upper_half: bool,
    },
}

/// A camera of the recording.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct HeaderCamera {
    /// Its name.
    pub name: String,
    /// `train` or `test`.
    pub split: String,
    /// `rgb`, `event` or `both`.
    pub modality: String,
    /// Image size, intrinsics and pose.
    #[serde(flatten)]
    pub view: View,
    /// Its near plane, metres.
    pub near: f32,
    /// Time, start and end of exposure of each frame, in [0, 1].
    pub frames: Vec<[f64; 3]>,
}

/// When events came.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct HeaderEvents {
    /// Edges of the bins, in [0, 1].
    pub edges: Vec<f64>,
    /// Events in each bin, over all cameras.
    pub counts: Vec<f64>,
}

impl SceneFile {
    /// The scene of a run as it stands.
    ///
    /// # Errors
    /// [`TrainError`] where the device fails.
    pub fn of(trainer: &Trainer<'_>) -> Result<Self, TrainError> {
        let checkpoint = trainer.checkpoint()?;
        let gaussians = &checkpoint.population.gaussians;
        let scene = &trainer.scene;
        let (motion, only_server) = motion(&checkpoint, scene);
        let options = trainer.options();
        let every = scene.points.len().div_ceil(POINTS).max(1);
        let points: Vec<f32> = scene.points.iter().step_by(every).flat_map(|(place, _)| *place).collect();
        let mut sections: Vec<(String, &[f32])> =
            vec![("core".into(), &gaussians.core), ("sh".into(), &gaussians.sh), ("points".into(), &points)];
        match (&motion, &checkpoint.field) {
            (HeaderMotion::FreeTime { .. }, _) => sections.push(("motion".into(), &gaussians.motion)),
            (HeaderMotion::Hexplane { .. }, Some(field)) => sections.extend(learned(field)),
            _ => {}
        }
        let still = matches!(motion, HeaderMotion::Still);
        let header = Header {
            count: gaussians.len(),
            dynamic: if still { 0 } else { gaussians.dynamic },
            sh_degree: gaussians.sh_degree,
            active_sh_degree: options.sh_degree,
            background: options.background,
            near: [checkpoint.config.near_m, checkpoint.config.near_share],
            near_sigmas: options.near_sigmas,
            span_ns: scene.dataset.manifest.span_ns,
            motion,
            only_server,
            cameras: cameras(trainer),
            events: events(scene),
            sections: sections.iter().map(|(name, values)| (name.clone(), values.len())).collect(),
        };
        let bytes = encode(&header, sections.iter().map(|(_, values)| *values));
        Ok(Self { bytes, header })
    }
}

#[cfg(test)]
impl SceneFile {
    /// One Gaussian that stands still.
    pub(crate) fn for_tests() -> Self {
        let sections = [("core", 12), ("sh", 4), ("points", 0)].map(|(name, count)| (name.to_owned(), count));
        let header = Header {
            count: 1,
            dynamic: 0,
            sh_degree: 0,
            active_sh_degree: 0,
            background: [0.0; 3],
            near: [0.2, 0.0],
            near_sigmas: 3.0,
            span_ns: [0, 1_000_000_000],
            motion: HeaderMotion::Still,
            only_server: None,
            cameras: Vec::new(),
            events: HeaderEvents::default(),
            sections: sections.to_vec(),
        };
        let bytes = encode(&header, [&[0.0; 12][..], &[0.0; 4], &[]].into_iter());
        Self { bytes, header }
    }
}

fn encode<'a>(header: &Header, sections: impl Iterator<Item = &'a [f32]>) -> Vec<u8> {
    // A header of numbers, names and lists is always JSON.
    let mut text = serde_json::to_vec(header).unwrap_or_default();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut bytes = MAGIC.to_vec();
    bytes.extend((text.len() as u32).to_le_bytes());
    bytes.extend(text);
    for values in sections {
        bytes.extend(values.iter().flat_map(|value| value.to_le_bytes()));
    }
    bytes
}

/// The vectors of a field that are parameters, not moments.
fn learned(field: &FieldState) -> impl Iterator<Item = (String, &[f32])> {
    let learned = |name: &str| !name.ends_with(".m") && !name.ends_with(".v");
    let vectors = field.vectors.iter().filter(move |vector| learned(&vector.name));
    vectors.map(|vector| (vector.name.clone(), &vector.values[..]))
}

/// How the Gaussians move, and what of that a browser cannot compute.
fn motion(checkpoint: &Checkpoint, scene: &Scene) -> (HeaderMotion, Option<String>) {
    let config = &checkpoint.config;
    if checkpoint.clock.stage == Stage::Coarse || checkpoint.population.gaussians.dynamic == 0 {
        return (HeaderMotion::Still, None);
    }
    match config.motion {
        MotionModel::FreeTime => {
            let intervals = scene.intervals() as f32;
            let least_life = config.free_time.least_life;
            (HeaderMotion::FreeTime { intervals, least_life, gone: erfgs_train::motion::free_time::GONE }, None)
        }
        MotionModel::HexPlane | MotionModel::Auto => {
            let field = &config.field;
            let beyond = if field.sh_head {
                Some("its field deforms colours")
            } else if field.depth > 1 {
                Some("its network has several hidden layers")
            } else if !field.width.is_multiple_of(4) || !field.features.is_multiple_of(4) {
                Some("its network has a width that is no multiple of four")
            } else {
                None
            };
            let motion = HeaderMotion::Hexplane {
                aabb: checkpoint.field_box,
                levels: field.levels.clone(),
                features: field.features,
                width: field.width,
                spatial_resolution: field.spatial_resolution,
                upper_half: field.upper_half_time,
            };
            (motion, beyond.map(str::to_owned))
        }
    }
}

fn cameras(trainer: &Trainer<'_>) -> Vec<HeaderCamera> {
    let scene = &trainer.scene;
    let camera = |(view, of): (&erfgs_train::scene::SceneView, &erfgs_dataset::Camera)| {
        let times = |frame: &erfgs_dataset::Frame| {
            [frame.t_ns, frame.exposure_ns[0], frame.exposure_ns[1]].map(|t_ns| scene.to_unit(t_ns))
        };
        HeaderCamera {
            name: view.name.clone(),
            split: if view.split == Split::Test { "test".into() } else { "train".into() },
            modality: serde_json::to_value(of.modality)
                .ok()
                .and_then(|v| Some(v.as_str()?.to_owned()))
                .unwrap_or_default(),
            view: view.view,
            near: trainer.near(&view.view),
            frames: of.frames.iter().map(times).collect(),
        }
    };
    scene.views.iter().zip(&scene.dataset.manifest.cameras).map(camera).collect()
}

fn events(scene: &Scene) -> HeaderEvents {
    let counts = (0..scene.bins.len()).map(|bin| {
        let of = |camera: &erfgs_train::scene::EventView| -> f64 {
            camera.activity(bin, bin + 1, false).iter().map(|&count| f64::from(count)).sum()
        };
        scene.events.iter().filter(|camera| camera.knows(bin, bin + 1)).map(of).sum()
    });
    if scene.events.is_empty() {
        HeaderEvents::default()
    } else {
        HeaderEvents { edges: scene.bins.edges.clone(), counts: counts.collect() }
    }
}
