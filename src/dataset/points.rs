//! `erfgs dataset points`: the initial point cloud of a dataset.

use std::path::PathBuf;

use anyhow::Context;
use erfgs_dataset::{Dataset, PointCloudFile};
use erfgs_points::{Cloud, CloudOptions, ColmapProgram, FrameChoice, HullOptions, Method, attach, initial_cloud};

use super::fit;
use crate::{
    errors::Usage,
    terminal::{Terminal, table, thousands},
};

/// Make the initial point cloud of a dataset.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
The poses of the dataset are kept. Held-out cameras and event-only cameras take no part. The poses of cameras with frames are \
first checked against static features of their pictures, and event cameras are checked for being upside down. Cameras that do \
not fit are refused.

Methods:
  colmap        features and triangulation by COLMAP 3.8 or 4.x, matched along epipolar lines
  sweep         dense plane sweep; needs no COLMAP
  colmap+sweep  both
  random        uniform in the box that the cameras see

Examples:
  erfgs dataset points ds-dv
  erfgs dataset points ds-dv --method colmap+sweep --max-points 80000
  erfgs dataset points ds-dv --moving 0
  erfgs dataset points ds-dv --colmap pycolmap:venv/bin/python")]
pub struct Arguments {
    /// The dataset.
    dataset: PathBuf,
    #[command(flatten)]
    choice: Choice,
    /// Number of instants, spread over the recording, at which points are searched.
    #[arg(long, value_name = "N", conflicts_with = "frames")]
    instants: Option<usize>,
    /// Instants at which points are searched: names of image files without extension, separated by commas.
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    frames: Option<Vec<String>>,
    /// Number of instants at which points are added on the visual hull of moving pixels; 0 for none. Default: 12.
    #[arg(long, value_name = "N")]
    moving: Option<u32>,
    /// Maximum number of moving points, over all those instants.
    #[arg(long, value_name = "N", default_value_t = HullOptions::default().max_points)]
    moving_points: u32,
    /// Nearest and farthest depth of a point, metres. Default: derived from the camera poses.
    #[arg(long, value_name = "NEAR..FAR", value_parser = depth_range)]
    depth: Option<[f64; 2]>,
    /// Maximum number of static points; 0 keeps all.
    #[arg(long, value_name = "N")]
    max_points: Option<usize>,
    /// Number of points of the random method.
    #[arg(long, value_name = "N")]
    random_points: Option<usize>,
    /// Seed of the random method.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Number of threads. Default: all cores.
    #[arg(long, value_name = "N")]
    jobs: Option<usize>,
}

/// Which method, and which COLMAP; `erfgs train` takes these too.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct Choice {
    /// Method for the initial points: colmap, sweep, colmap+sweep or random.
    #[arg(long = "method", visible_alias = "init", value_name = "METHOD")]
    method: Option<Method>,
    /// The COLMAP to use: a program, `pycolmap`, or `pycolmap:PYTHON`. Default: searched for.
    #[arg(long, value_name = "PROGRAM")]
    colmap: Option<ColmapProgram>,
    /// Accept the poses without comparing them with the pictures.
    #[arg(long)]
    trust_poses: bool,
}

fn depth_range(text: &str) -> Result<[f64; 2], String> {
    let wrong = || format!("'{text}' is not a range of depths in metres; write for example 0.3..6");
    let (near, far) = text.split_once("..").ok_or_else(wrong)?;
    let range = [near, far].map(|part| part.trim().parse::<f64>().unwrap_or(f64::NAN));
    if range[0] > 0.0 && range[1] > range[0] && range[1].is_finite() { Ok(range) } else { Err(wrong()) }
}

impl Arguments {
    fn options(&self) -> CloudOptions {
        let mut options = CloudOptions { seed: self.seed, depth_m: self.depth, ..CloudOptions::default() };
        options.method = self.choice.method.unwrap_or_default();
        options.colmap.program = self.choice.colmap.clone().unwrap_or_default();
        if let Some(instants) = self.instants {
            options.frames = FrameChoice::Spread(instants);
        }
        if let Some(names) = &self.frames {
            options.frames = FrameChoice::Named(names.clone());
        }
        match self.max_points {
            Some(0) => options.max_points = None,
            Some(most) => options.max_points = Some(most),
            None => {}
        }
        if let Some(instants) = self.moving {
            options.hull.instants = instants;
        }
        options.hull.max_points = self.moving_points;
        if let Some(count) = self.random_points {
            options.random_points = count;
        }
        if let Some(jobs) = self.jobs {
            options.threads = jobs;
        }
        options
    }
}

/// Makes the cloud and names it in the manifest.
pub fn run(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<()> {
    if arguments.instants == Some(0) {
        return Err(Usage("--instants must be at least 1".into()).into());
    }
    let mut dataset = Dataset::load(&arguments.dataset)?;
    let file = if arguments.choice.trust_poses {
        make_trusting(&mut dataset, &arguments.options(), terminal)?
    } else {
        make(&mut dataset, &arguments.options(), terminal)?
    };
    terminal.result(&file, || {
        let mut rows = vec![
            vec!["points".into(), thousands(file.count)],
            vec!["method".into(), file.method.clone()],
            vec!["file".into(), dataset.root.join(&file.file).display().to_string()],
        ];
        for (name, value) in file.parameters.iter().filter(|(_, value)| value.is_number()) {
            rows.push(vec![name.replace('_', " "), value.to_string()]);
        }
        table(&rows)
    })
}

/// Makes the cloud by the poses as they are, writes it and names it in the manifest.
pub fn make_trusting(
    dataset: &mut Dataset,
    options: &CloudOptions,
    terminal: &Terminal,
) -> anyhow::Result<PointCloudFile> {
    let cloud = cloud(dataset, options, terminal)?;
    Ok(attach(dataset, &cloud)?)
}

/// Holds the poses against the pictures and the events, makes the cloud, writes it and names it in the manifest.
pub fn make(dataset: &mut Dataset, options: &CloudOptions, terminal: &Terminal) -> anyhow::Result<PointCloudFile> {
    fit::check(dataset, &options.colmap.program, terminal)?;
    let cloud = cloud(dataset, options, terminal)?;
    fit::check_events(dataset, &cloud)?;
    Ok(attach(dataset, &cloud)?)
}

fn cloud(dataset: &Dataset, options: &CloudOptions, terminal: &Terminal) -> anyhow::Result<Cloud> {
    let work = erfgs_base::scratch::Scratch::new().context("cannot make a folder for intermediate files")?;
    let progress = terminal.progress("initial point cloud");
    let cloud = initial_cloud(dataset, options, work.path(), &|stage, done, total| {
        progress.update(done as u64, total as u64, &stage.to_string());
    })?;
    drop(progress);
    Ok(cloud)
}
