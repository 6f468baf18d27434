//! How the bodies of a run move, as numbers: a table of places, rotations and rates.
//!
//! A body is rigid but for its nodes, so that its motion is that which takes its Gaussians from where they rest to where they stand at an
//! instant with the least sum of squares, each weighted by its opacity; what is left is how far it bends.

use std::path::{Path, PathBuf};

use erfgs_base::{FileError, atomic, text::csv_cell};
use erfgs_calibrate::geometry::rigid;
use erfgs_run::RunFolder;
use erfgs_scene::Pose;
use erfgs_splat::{gaussians::Gaussians, trained::TrainedScene};
use glam::{DQuat, DVec3};
use serde::Serialize;

use crate::{
    device::TrainedRun,
    errors::{Usage, not_over},
    terminal::{Terminal, bytes, thousands},
};

/// The file in the run's folder, where no other is named.
const NAME: &str = "motion.csv";
/// Instants in a second, and of a recording at most, where nothing is said of them.
const A_SECOND: f64 = 250.0;
const MOST: f64 = 2000.0;
/// A body is there while its Gaussians are so opaque in the mean, compared with how they are at rest.
const THERE: f64 = 0.5;
/// What its Gaussians weigh together must be more than that of a few that can hardly be seen.
const FAINT: f64 = 0.1;
const COLUMNS: &str = "body,t_ns,t_s,x_m,y_m,z_m,vx_m_s,vy_m_s,vz_m_s,qw,qx,qy,qz,wx_rad_s,wy_rad_s,wz_rad_s,bends_m";

/// A body at an instant.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Sample {
    t_ns: i64,
    /// Its middle.
    place: DVec3,
    /// From how it rests.
    rotation: DQuat,
    bends_m: f64,
}

/// The Gaussians of a body.
struct Member {
    index: usize,
    /// At rest, in the frame of the body.
    place: DVec3,
    weight: f64,
}

/// A body that is followed.
struct Followed {
    name: String,
    members: Vec<Member>,
    samples: Vec<Sample>,
}

#[derive(Serialize)]
struct Moved {
    body: String,
    gaussians: usize,
    instants: usize,
    /// How far its path is, metres, and how fast it is at most.
    path_m: f64,
    fastest_m_s: f64,
    fastest_rad_s: f64,
    /// The root of the mean square.
    bends_m: f64,
}

#[derive(Serialize)]
struct Exported {
    file: PathBuf,
    bytes: u64,
    bodies: Vec<Moved>,
}

/// Writes the table.
pub fn run(
    run: &TrainedRun,
    instants: Option<u32>,
    out: Option<&Path>,
    force: bool,
    terminal: &Terminal,
) -> anyhow::Result<()> {
    let folder = run.folder()?;
    let file = out.map_or_else(|| folder.root().join(NAME), Path::to_owned);
    not_over(&file, force)?;
    let gpu = run.device()?;
    let mut scene = run.scene(&gpu, &folder)?;
    let mut followed = bodies(&scene, &folder)?;
    let [begin, end] = scene.record().span_ns;
    let seconds = 1e-9 * end.saturating_sub(begin) as f64;
    let instants = instants.unwrap_or_else(|| (A_SECOND * seconds).round().min(MOST) as u32 + 1).max(2);
    let progress = terminal.progress("following the bodies");
    for index in 0..instants {
        progress.update(index.into(), instants.into(), "instants");
        let t01 = f64::from(index) / f64::from(instants - 1);
        let t_ns = scene.record().from_unit(t01);
        let there = scene.gaussians_at(t01)?;
        for body in &mut followed {
            let sample = sample(&body.members, t_ns, &there);
            body.samples.extend(sample);
        }
    }
    drop(progress);
    let mut table = format!("{COLUMNS}\n");
    followed.iter().for_each(|body| table.push_str(&rows(body, begin)));
    atomic::write(&file, table.as_bytes()).map_err(FileError::when("write", &file))?;
    let exported = Exported { file, bytes: table.len() as u64, bodies: followed.iter().map(moved).collect() };
    terminal.result(&exported, || exported.words())
}

impl Exported {
    fn words(&self) -> String {
        let Self { file, bytes: size, bodies } = self;
        let mut text = format!("{}: {} bodies, {}", file.display(), bodies.len(), bytes(*size));
        for Moved { body, gaussians, instants, path_m, fastest_m_s, fastest_rad_s, bends_m } in bodies {
            text.push_str(&format!(
                "\n  {body}: {instants} instants, {path_m:.2} m, up to {fastest_m_s:.2} m/s and {fastest_rad_s:.1} rad/s, bends by {:.1} mm; {} Gaussians",
                1e3 * bends_m,
                thousands(*gaussians as u64)
            ));
        }
        text
    }
}

/// The bodies of a run, with what hangs on them.
fn bodies(scene: &TrainedScene<'_>, folder: &RunFolder) -> Result<Vec<Followed>, Usage> {
    let learned = scene.learned();
    let names = learned.record.motion.bodies();
    if names.is_empty() {
        return Err(Usage(format!(
            "no body carries anything in {}; train it with --motion bodies, after `erfgs dataset bodies`",
            folder.root().display()
        )));
    }
    let mut all: Vec<Followed> =
        names.iter().map(|name| Followed { name: name.clone(), members: Vec::new(), samples: Vec::new() }).collect();
    let gaussians = &learned.gaussians;
    for (index, row) in gaussians.motion.chunks_exact(gaussians.motion_floats.max(1)).enumerate() {
        if let Some(body) = learned.record.motion.body_of(row) {
            let (place, weight) = (place(gaussians, index), gaussians.opacity(index).into());
            all[body].members.push(Member { index, place, weight });
        }
    }
    Ok(all)
}

fn place(gaussians: &Gaussians, index: usize) -> DVec3 {
    gaussians.mean(index).map(f64::from).into()
}

/// A body at an instant, from where all Gaussians are then; none while it is not there.
fn sample(members: &[Member], t_ns: i64, there: &Gaussians) -> Option<Sample> {
    let at_rest: f64 = members.iter().map(|member| member.weight).sum();
    let now: f64 = members.iter().map(|member| f64::from(there.opacity(member.index))).sum();
    if at_rest < FAINT || now < THERE * at_rest {
        return None;
    }
    let pairs = members.iter().map(|member| (member.place, place(there, member.index), member.weight));
    let pairs: Vec<_> = pairs.collect();
    let Pose { rotation, translation } = rigid(&pairs)?;
    let apart = |(rest, place, weight): &(DVec3, DVec3, f64)| {
        weight * (rotation * *rest + translation).distance_squared(*place)
    };
    let bends_m = (pairs.iter().map(apart).sum::<f64>() / at_rest).sqrt();
    Some(Sample { t_ns, place: translation, rotation, bends_m })
}

/// Velocity, metres per second, and rate, radians per second, at each sample: from the one before to the one after.
fn rates(samples: &[Sample]) -> Vec<[DVec3; 2]> {
    let rate = |at: usize| {
        let (a, b) = (&samples[at.saturating_sub(1)], &samples[(at + 1).min(samples.len() - 1)]);
        let seconds = 1e-9 * b.t_ns.saturating_sub(a.t_ns) as f64;
        let turn = b.rotation * a.rotation.conjugate();
        let turn = if turn.w < 0.0 { -turn } else { turn };
        [b.place - a.place, turn.to_scaled_axis()].map(|change| change / seconds.max(1e-9))
    };
    (0..samples.len()).map(rate).collect()
}

/// The rows of a body, whose rotations change sign nowhere.
fn rows(body: &Followed, begin_ns: i64) -> String {
    let name = csv_cell(&body.name);
    let mut last = DQuat::IDENTITY;
    let row = |(sample, [velocity, rate]): (&Sample, [DVec3; 2])| {
        let Sample { t_ns, place, mut rotation, bends_m } = *sample;
        if rotation.dot(last) < 0.0 {
            rotation = -rotation;
        }
        last = rotation;
        let seconds = 1e-9 * t_ns.saturating_sub(begin_ns) as f64;
        let turn = [rotation.w, rotation.x, rotation.y, rotation.z];
        let metres = place.to_array().into_iter().chain(velocity.to_array());
        let numbers: String = metres.chain(turn).chain(rate.to_array()).map(|number| format!(",{number:.5}")).collect();
        format!("{name},{t_ns},{seconds:.6}{numbers},{bends_m:.5}\n")
    };
    std::iter::zip(&body.samples, rates(&body.samples)).map(row).collect()
}

fn moved(body: &Followed) -> Moved {
    let samples = &body.samples;
    let rates = rates(samples);
    let fastest = |which: usize| rates.iter().map(|rate| rate[which].length()).fold(0.0, f64::max);
    let bends = samples.iter().map(|sample| sample.bends_m.powi(2)).sum::<f64>() / samples.len().max(1) as f64;
    Moved {
        body: body.name.clone(),
        gaussians: body.members.len(),
        instants: samples.len(),
        path_m: samples.windows(2).map(|pair| pair[0].place.distance(pair[1].place)).sum(),
        fastest_m_s: fastest(0),
        fastest_rad_s: fastest(1),
        bends_m: bends.sqrt(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn samples() -> Vec<Sample> {
        let at = |k: i32| {
            let seconds = 0.01 * f64::from(k);
            Sample {
                t_ns: 10_000_000 * i64::from(k),
                place: DVec3::new(3.0 * seconds, 0.0, 4.9 * seconds * seconds),
                rotation: DQuat::from_rotation_y(40.0 * seconds),
                bends_m: 0.001,
            }
        };
        (0..20).map(at).collect()
    }

    #[test]
    fn rates_are_those_of_the_motion() {
        let samples = samples();
        for (sample, [velocity, rate]) in std::iter::zip(&samples, rates(&samples)).skip(1).take(18) {
            let falls = 9.8 * 1e-9 * sample.t_ns as f64;
            assert!(velocity.distance(DVec3::new(3.0, 0.0, falls)) < 1e-9, "{velocity}");
            assert!(rate.distance(40.0 * DVec3::Y) < 1e-9, "{rate}");
        }
        assert_eq!(rates(&samples[..1]), [[DVec3::ZERO; 2]]);
    }

    #[test]
    fn rotations_do_not_change_their_sign_and_names_are_fields() {
        let body = Followed { name: "a \"b\", c".into(), members: Vec::new(), samples: samples() };
        let text = rows(&body, 0);
        let turns: Vec<DQuat> = text
            .lines()
            .map(|line| {
                let line = line.strip_prefix("\"a \"\"b\"\", c\",").expect("its name");
                let numbers: Vec<f64> = line.split(',').map(|field| field.parse().expect("a number")).collect();
                assert_eq!(numbers.len(), COLUMNS.split(',').count() - 1);
                DQuat::from_xyzw(numbers[9], numbers[10], numbers[11], numbers[8])
            })
            .collect();
        assert!(turns.windows(2).all(|pair| pair[0].dot(pair[1]) > 0.9), "{text}");
    }

    #[test]
    fn of_a_body_without_samples_nothing_is_said() {
        let body = Followed { name: "ball".into(), members: Vec::new(), samples: Vec::new() };
        let Moved { instants, path_m, fastest_m_s, bends_m, .. } = moved(&body);
        assert_eq!((instants, path_m, fastest_m_s, bends_m), (0, 0.0, 0.0, 0.0));
        assert_eq!(rows(&body, 0), "");
    }
}
