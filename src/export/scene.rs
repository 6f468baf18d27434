//! What a run learned as one file to share.

use std::path::{Path, PathBuf};

use erfgs_base::atomic;
use erfgs_scene::ply::GaussianCloud;
use erfgs_view::{Learned, Precision, Written, alone, fourdgs, gltf, scene_file::fidelity, spz};
use serde::Serialize;

use crate::{
    device::{Adapter, TrainedRun},
    errors::{Usage, not_over},
    takes::{self, TakePage, WindowRun},
    terminal::{Terminal, bytes, thousands},
};

/// The kinds of files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SceneFormat {
    /// The page, with the scene in it.
    Html,
    /// The scene alone.
    E4d,
    /// The open container.
    FourDgs,
    /// An instant, as glTF.
    Gltf,
    /// An instant, packed for viewers.
    Spz,
}

impl SceneFormat {
    /// The file in the run's folder, where no other is named.
    fn name(self) -> &'static str {
        match self {
            Self::Html => "view.html",
            Self::E4d => "scene.e4d",
            Self::FourDgs => "scene.4dgs",
            Self::Gltf => "scene.glb",
            Self::Spz => "scene.spz",
        }
    }

    /// Whether it holds one instant.
    fn is_instant(self) -> bool {
        matches!(self, Self::Gltf | Self::Spz)
    }
}

/// How to write it.
#[derive(Clone, Copy, Debug)]
pub struct SceneOptions<'a> {
    /// As what.
    pub format: SceneFormat,
    /// Where to; in the run's folder without it.
    pub out: Option<&'a Path>,
    /// Whether what exists may be overwritten.
    pub force: bool,
    /// Whether numbers are kept to the bit.
    pub exact: bool,
    /// The instant that glTF and SPZ show, seconds from the start of the recording.
    pub at: Option<f64>,
}

#[derive(Serialize)]
struct Exported {
    file: PathBuf,
    gaussians: usize,
    bytes: u64,
    /// Of its pictures against those of the run, where numbers were packed.
    psnr_db: Option<f64>,
    /// What the format cannot hold.
    left_out: Vec<String>,
}

impl Exported {
    fn words(&self) -> String {
        let Self { file, gaussians, bytes: size, psnr_db, .. } = self;
        let mut text = format!("{}: {} Gaussians, {}", file.display(), thousands(*gaussians as u64), bytes(*size));
        text.extend(psnr_db.map(|decibels| format!(", {decibels:.1} dB against the run's own pictures")));
        text
    }
}

/// Writes the page of a long take.
pub fn take(
    windows: &[WindowRun],
    file: &Path,
    options: SceneOptions<'_>,
    adapter: &Adapter,
    terminal: &Terminal,
) -> anyhow::Result<()> {
    if options.format != SceneFormat::Html {
        return Err(Usage("a take is exported --to html; name one of its runs for anything else".into()).into());
    }
    not_over(file, options.force)?;
    let precision = if options.exact { Precision::Exact } else { Precision::Packed };
    let TakePage { text, gaussians, psnr_db } = takes::page(windows, precision, adapter, terminal)?;
    takes::write_page(file, &text)?;
    let (file, bytes) = (file.to_owned(), text.len() as u64);
    let exported = Exported { file, gaussians, bytes, psnr_db, left_out: Vec::new() };
    terminal.result(&exported, || format!("{}; it opens from a disk", exported.words()))
}

/// Writes the file.
pub fn run(run: &TrainedRun, options: SceneOptions<'_>, terminal: &Terminal) -> anyhow::Result<()> {
    let SceneOptions { format, out, force, exact, at } = options;
    let folder = run.folder()?;
    let file = out.map_or_else(|| folder.root().join(format.name()), Path::to_owned);
    not_over(&file, force)?;
    if exact && (format == SceneFormat::FourDgs || format.is_instant()) {
        let why = "--exact is for html and e4d; 4dgs and spz have their own coding, and gltf is exact";
        return Err(Usage(why.into()).into());
    }
    if at.is_some() && !format.is_instant() {
        return Err(Usage("--at is for gltf and spz, which hold one instant".into()).into());
    }
    let gpu = run.device()?;
    let mut scene = run.scene(&gpu, &folder)?;
    let (written, gaussians, psnr_db, left_out) = if format == SceneFormat::FourDgs {
        let progress = terminal.progress("following what moves");
        let on_progress = &mut |done, of| progress.update(done, of, "instants");
        let fourdgs::Written { bytes, gaussians, left_out } = fourdgs::write(&mut scene, on_progress)?;
        (bytes, gaussians, None, left_out)
    } else if format.is_instant() {
        let [start, end] = scene.record().span_ns;
        let seconds = end.saturating_sub(start) as f64 / 1e9;
        let at = at.unwrap_or(seconds / 2.0);
        if at > seconds {
            return Err(Usage(format!("--at {at} is behind the end: the recording is {seconds:.3} s long")).into());
        }
        let cloud = GaussianCloud::from(&scene.gaussians_at(at / seconds.max(f64::MIN_POSITIVE))?);
        let Written { bytes, gaussians } =
            if format == SceneFormat::Spz { spz::write(&cloud)? } else { gltf::write(&cloud)? };
        let faint = cloud.len() - gaussians;
        let left_out = (faint > 0).then(|| format!("{} Gaussians that cannot be seen then", thousands(faint as u64)));
        (bytes, gaussians, None, left_out.into_iter().collect())
    } else {
        let packed = Learned::of(scene.learned()).file(if exact { Precision::Exact } else { Precision::Packed });
        if format == SceneFormat::Html {
            takes::browsers_draw(&packed, &run.run)?;
        }
        let name = folder.name();
        let written = match format {
            SceneFormat::Html => {
                alone::page(&[alone::Packed { name: &name, scene: &packed, window: None }])?.into_bytes()
            }
            _ => packed.compressed(),
        };
        let psnr_db = if exact { None } else { Some(fidelity(scene, &packed)?) };
        (written, packed.header.count, psnr_db, Vec::new())
    };
    atomic::write(&file, &written).map_err(erfgs_base::FileError::when("write", &file))?;
    let exported = Exported { file, gaussians, bytes: written.len() as u64, psnr_db, left_out };
    terminal.result(&exported, || {
        let mut text = exported.words();
        if format == SceneFormat::Html {
            text.push_str("; it opens from a disk");
        }
        text.extend(exported.left_out.iter().map(|what| format!("\nleft out: {what}")));
        text
    })
}
