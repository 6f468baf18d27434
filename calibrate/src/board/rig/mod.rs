//! All cameras of a rig from the boards that they saw.

mod alone;
mod options;
mod together;
mod warnings;

use erfgs_scene::rig_file::RigFile;

pub use self::options::BoardOptions;

use self::{alone::by_themselves, options::check, together::together};
use super::{
    BoardDetections, BoardError, Plate,
    alone::Alone,
    back,
    joint::{Tied, sightings},
    link::{self, Linked, Sightings},
    plate::Face,
    remedies::{self, Refused},
};
use crate::evidence::Evidence;

/// A rig, what it was made from, and what was seen by its cameras, in its order.
pub(super) type Calibrated = (RigFile, Evidence);

/// Calibrates every camera alone, then all together where there is more than one. A camera that sees too little is left out
/// where two others remain, and the rig's first warning says so; one that no board ties to the others is in the rig without a
/// pose. Of a board with two sides it is found, too, where its back is; the rig's measures and a table tell. `progress` is told
/// what is done next.
///
/// # Errors
/// If options fit nothing that was recorded, no camera or no two cameras see enough, or what the cameras say together
/// contradicts what each of them says.
pub fn calibrate(
    seen: &[BoardDetections],
    plate: impl Into<Plate>,
    options: &BoardOptions,
    progress: &dyn Fn(usize, usize, &str),
) -> Result<Calibrated, BoardError> {
    let plate = &plate.into();
    check(seen, options)?;
    let wanted: Vec<&BoardDetections> = seen.iter().filter(|seen| !options.without.contains(&seen.camera)).collect();
    let (mut cameras, mut failed) = (Vec::new(), Vec::new());
    for (index, seen) in wanted.iter().enumerate() {
        progress(index, wanted.len() + 1, &seen.camera);
        match Alone::of(seen, plate, options) {
            Ok(alone) => cameras.push((*seen, alone)),
            Err(error @ (BoardError::TooFewViews { .. } | BoardError::NoFocal { .. } | BoardError::Open { .. })) => {
                failed.push(error)
            }
            Err(error) => return Err(error),
        }
    }
    let enough = cameras.len() >= if options.intrinsics_only { 1 } else { 2 };
    if !failed.is_empty() && !enough {
        return Err(failed.remove(0));
    }
    let left_out: Vec<String> = failed.iter().map(|error| format!("left out: {error}")).collect();
    let (seen, alone): (Vec<&BoardDetections>, Vec<&Alone>) =
        cameras.iter().map(|(seen, alone)| (*seen, alone)).unzip();
    if options.intrinsics_only || seen.len() < 2 {
        let (mut rig, evidence) = by_themselves(&seen, &alone);
        rig.warnings.splice(0..0, left_out);
        return Ok((rig, evidence));
    }
    let several = Several { seen: &seen, alone: &alone, plate };
    let report = |what: &str| progress(wanted.len(), wanted.len() + 1, what);
    report("all cameras");
    let found = several.calibrate(options).map(|fitted| fitted.calibrated);
    let mut found = found.map_err(|failed| match failed {
        Failed::Refused(refused) => {
            let tried = remedies::tried(&several, &refused, options, &report);
            refused.error(tried)
        }
        Failed::Other(error) => error,
    });
    match &mut found {
        Ok((rig, _)) => {
            rig.warnings.splice(0..0, left_out);
        }
        Err(BoardError::Apart { alone, .. } | BoardError::BackOpen { alone, .. }) => {
            alone.0.warnings.splice(0..0, left_out);
        }
        Err(_) => {}
    }
    found
}

/// Cameras each of which was solved by itself.
#[derive(Clone, Copy)]
pub(super) struct Several<'a> {
    pub seen: &'a [&'a BoardDetections],
    pub alone: &'a [&'a Alone],
    pub plate: &'a Plate,
}

/// Why there is no rig.
pub(super) enum Failed {
    /// What the cameras say together contradicts what each of them says.
    Refused(Box<Refused>),
    Other(BoardError),
}

impl<E: Into<BoardError>> From<E> for Failed {
    fn from(error: E) -> Self {
        Self::Other(error.into())
    }
}

impl Several<'_> {
    /// All of them together.
    pub fn calibrate(&self, options: &BoardOptions) -> Result<Fitted, Failed> {
        let Self { seen, alone, plate } = *self;
        let names = |indices: &[usize]| indices.iter().map(|i| seen[*i].camera.clone()).collect::<Vec<String>>();
        let lenses = || Box::new(by_themselves(seen, alone));
        let open = |front: &[usize], back: &[usize], known: String| BoardError::BackOpen {
            front: names(front),
            back: names(back),
            known,
            alone: lenses(),
        };
        let all = sightings(seen, plate, alone);
        let stated = plate.back().zip(options.back_thickness_m);
        let stated = stated.map(|(back, thickness_m)| back::stated(plate.front(), back, thickness_m));
        let mut keep = false;
        loop {
            let linked = link::link(&all, stated, keep);
            let linked =
                linked.map_err(|found| open(&found.front, &found.back, "its rotations determine too little".into()))?;
            if linked.chain.cameras.len() < 2 {
                let everyone: Vec<usize> = (0..seen.len()).collect();
                let (one, other) = (names(&everyone[..1]), names(&everyone[1..]));
                return Err(BoardError::Apart { one, other, alone: lenses() }.into());
            }
            match with_poses(seen, alone, plate, &linked, options)? {
                Outcome::Rig(fitted) => return Ok(*fitted),
                Outcome::Refused(refused) => return Err(Failed::Refused(refused)),
                // What was stated takes the place of what remains open.
                Outcome::BackOpen(_) if stated.is_some() && !keep => keep = true,
                Outcome::BackOpen(known) => {
                    let saw = |face| seen_by(&all, &linked, face);
                    return Err(open(&saw(Face::Front), &saw(Face::Back), format!("it is known {known}")).into());
                }
            }
        }
    }
}

/// A rig that may be written.
pub(super) struct Fitted {
    pub calibrated: Calibrated,
    /// Whether something speaks against it, though not enough to refuse it.
    pub doubtful: bool,
}

/// What all cameras together give.
enum Outcome {
    Rig(Box<Fitted>),
    /// Where the board's back is remains open: how well it is known, in words.
    BackOpen(String),
    /// It contradicts what each camera says.
    Refused(Box<Refused>),
}

/// The cameras of the chain that saw a side.
fn seen_by(all: &[Sightings], linked: &Linked, face: Face) -> Vec<usize> {
    let saw = |camera: &&usize| all[**camera].values().any(|(seen, _)| *seen == face);
    linked.chain.cameras.iter().filter(saw).copied().collect()
}

/// The cameras of the chain with poses, and the others without.
fn with_poses(
    seen: &[&BoardDetections],
    alone: &[&Alone],
    plate: &Plate,
    linked: &Linked,
    options: &BoardOptions,
) -> Result<Outcome, BoardError> {
    let Linked { chain, boards, back } = linked;
    let is_tied = |index: &usize| chain.cameras.contains(index);
    let boards: Vec<_> = chain.cameras.iter().map(|index| boards[*index].clone()).collect();
    let apart: Vec<usize> = (0..seen.len()).filter(|index| !is_tied(index)).collect();
    let pick = |indices: &[usize]| -> (Vec<&BoardDetections>, Vec<&Alone>) {
        indices.iter().map(|index| (seen[*index], alone[*index])).unzip()
    };
    let ((seen, alone), (lone_seen, lone)) = (pick(&chain.cameras), pick(&apart));
    let tied = Tied { seen: &seen, plate, alone: &alone, chain, boards: &boards, back: *back };
    let Fitted { calibrated: (mut rig, evidence), doubtful } = match together(tied, options)? {
        Outcome::Rig(fitted) => *fitted,
        other => return Ok(other),
    };
    let names: Vec<&str> = lone_seen.iter().map(|seen| seen.camera.as_str()).collect();
    if !names.is_empty() {
        rig.warnings.insert(
            0,
            format!("no board connects these cameras to the others, so that they have no pose: {}", names.join(", ")),
        );
        rig.cameras.extend(by_themselves(&lone_seen, &lone).0.cameras);
    }
    Ok(Outcome::Rig(Box::new(Fitted { calibrated: (rig, evidence), doubtful })))
}
