//! All cameras of a rig from the boards that they saw.

use std::collections::{BTreeMap, BTreeSet};

use glam::DVec3;

use erfgs_scene::{
    Intrinsics, Modality,
    rig_file::{RigCamera, RigFile, Sigma},
};

use super::{
    BoardError, LensModel, Plate, Seen,
    alone::Alone,
    back::{self, Told},
    doubt::Doubts,
    joint::{self, Joint, Tied, has_times, sightings},
    link::{self, Linked, Sightings},
    origin,
    plate::Face,
    remedies::{self, Offsets, Refused},
};
use crate::{
    bundle::{
        BundleError, Loss, Parameter, Placement, Uncertainty,
        jackknife::{MOST_GROUPS, successive},
    },
    coverage::Coverage,
    evidence::Evidence,
};

/// How a board calibration is done.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BoardOptions {
    /// The lens model.
    pub model: LensModel,
    /// Whether fy/fx is held at 1.
    pub square_pixels: bool,
    /// Intrinsics that are known, by camera; they are kept.
    pub known: BTreeMap<String, Intrinsics>,
    /// Whether each camera's time offset is estimated, from frame times and how the board moves.
    pub time_offsets: bool,
    /// How far the back of a board with two sides is behind its front, metres, if the sides are parallel and lie one behind the
    /// other. Without it, and where it is not so, the back is found.
    pub back_thickness_m: Option<f64>,
    /// Whether the intrinsics found camera by camera are kept while the poses are adjusted.
    pub keep_intrinsics: bool,
    /// Whether only intrinsics are wanted, and no poses.
    pub intrinsics_only: bool,
    /// Cameras that are left out.
    pub without: BTreeSet<String>,
    /// Instants whose pictures were not taken at once: they tell of lenses, and tie no cameras.
    pub untied: BTreeSet<String>,
    /// The instant whose board is the world: origin at its first corner, x along its rows, z out of the sheet. Without it the
    /// first camera is the world.
    pub origin: Option<String>,
}

impl BoardOptions {
    /// The parameters of a lens that is not known.
    pub(super) fn lens_parameters(&self) -> Vec<Parameter> {
        self.model.parameters_with(self.square_pixels)
    }
}

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
    seen: &[Seen],
    plate: impl Into<Plate>,
    options: &BoardOptions,
    progress: &dyn Fn(usize, usize, &str),
) -> Result<Calibrated, BoardError> {
    let plate = &plate.into();
    check(seen, options)?;
    let wanted: Vec<&Seen> = seen.iter().filter(|seen| !options.without.contains(&seen.camera)).collect();
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
    let (seen, alone): (Vec<&Seen>, Vec<&Alone>) = cameras.iter().map(|(seen, alone)| (*seen, alone)).unzip();
    if options.intrinsics_only || seen.len() < 2 {
        let (mut rig, evidence) = by_themselves(&seen, &alone);
        rig.warnings.splice(0..0, left_out);
        return Ok((rig, evidence));
    }
    let several = Several { seen: &seen, alone: &alone, plate };
    let told = |what: &str| progress(wanted.len(), wanted.len() + 1, what);
    told("all cameras");
    let found = several.calibrate(options).map(|fitted| fitted.calibrated);
    let mut found = found.map_err(|failed| match failed {
        Failed::Refused(refused) => {
            let tried = remedies::tried(&several, &refused, options, &told);
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
    pub seen: &'a [&'a Seen],
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
    seen: &[&Seen],
    alone: &[&Alone],
    plate: &Plate,
    linked: &Linked,
    options: &BoardOptions,
) -> Result<Outcome, BoardError> {
    let Linked { chain, boards, back } = linked;
    let is_tied = |index: &usize| chain.cameras.contains(index);
    let boards: Vec<_> = chain.cameras.iter().map(|index| boards[*index].clone()).collect();
    let apart: Vec<usize> = (0..seen.len()).filter(|index| !is_tied(index)).collect();
    let pick = |indices: &[usize]| -> (Vec<&Seen>, Vec<&Alone>) {
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

/// No plate is thicker, metres.
const THICKEST_M: f64 = 0.2;

/// Refuses options that fit nothing of what was recorded.
fn check(seen: &[Seen], options: &BoardOptions) -> Result<(), BoardError> {
    let names = || seen.iter().map(|seen| seen.camera.clone()).collect::<Vec<_>>();
    if let Some(thickness_m) = options.back_thickness_m.filter(|metres| !(0.0..=THICKEST_M).contains(metres)) {
        return Err(BoardError::Thickness { thickness_m });
    }
    let recorded = |name: &String| seen.iter().any(|seen| seen.camera == *name);
    let named = |instant: &String| seen.iter().flat_map(|seen| &seen.views).any(|view| view.instant == *instant);
    if let Some(name) = options.untied.iter().find(|instant| !named(instant)) {
        let known = seen.iter().flat_map(|seen| &seen.views).map(|view| &view.instant).collect::<BTreeSet<_>>();
        return Err(BoardError::NoInstant { name: name.clone(), known: known.into_iter().take(8).cloned().collect() });
    }
    if let Some(name) = options.without.iter().find(|name| !recorded(name)) {
        return Err(BoardError::NoCamera { name: name.clone(), cameras: names() });
    }
    if !options.known.is_empty() && !options.known.keys().any(recorded) {
        let known = options.known.keys().cloned().collect();
        return Err(BoardError::KnowsNone { known, cameras: names() });
    }
    for seen in seen {
        if let Some(known) = options.known.get(&seen.camera)
            && [known.width, known.height] != seen.size
        {
            return Err(BoardError::KnownSize {
                camera: seen.camera.clone(),
                known: [known.width, known.height],
                found: seen.size,
            });
        }
    }
    Ok(())
}

/// Each camera as it is by itself: no poses.
fn by_themselves(seen: &[&Seen], alone: &[&Alone]) -> Calibrated {
    let mut evidence = Evidence::default();
    let mut rig = RigFile::new("board", true, Vec::new());
    for (index, (seen, alone)) in seen.iter().zip(alone).enumerate() {
        let (name, modality) = (&seen.camera, modality(seen));
        if let Some(solution) = &alone.solution {
            evidence.pass(format!("intrinsics of {name}"), solution);
        }
        evidence.observe_also(&alone.bundle, index, &alone.moments);
        let mut camera = match &alone.single {
            Some(single) => {
                let mut own = alone.bundle.rig("board", &single.uncertainty, &[modality]);
                rig.quality = rig.quality.take().or(own.quality.take());
                own.cameras.remove(0)
            }
            None => {
                let mut camera = RigCamera::new(name, modality, alone.intrinsics, None);
                let (rms_px, observations) = alone.bundle.rms_px(None);
                (camera.rms_px, camera.observations) = (Some(rms_px), observations);
                camera
            }
        };
        // One camera stands nowhere but where it is.
        camera.pose = None;
        camera.warnings = coverage_warnings(seen);
        camera.warnings.extend(focal_warning(&camera));
        rig.cameras.push(camera);
    }
    if rig.cameras.len() > 1 {
        // Of several problems there is no one measure.
        rig.quality = None;
    }
    rig.warnings.extend(alone.iter().filter_map(|alone| alone.is_another()).map(|(_, sentence)| sentence));
    (rig, evidence)
}

/// A solution, what is known of it, and what speaks against it.
pub(super) struct Solved {
    pub joint: Joint,
    uncertainty: Uncertainty,
    pub doubts: Doubts,
}

/// Stretches of a recording of which one is left out at a time, where cameras do not run together.
const STRETCHES: usize = 6;

impl Solved {
    fn of(tied: Tied<'_>, options: &BoardOptions) -> Result<Self, BoardError> {
        let mut joint = joint::solve(tied, options)?;
        if let Some(name) = &options.origin {
            origin::put(&mut joint, tied.plate, name)?;
        }
        // What a track leaves over is alike for some frames, and how late they come wanders: what is left out in turn must be long.
        let most = if joint.timed { STRETCHES } else { MOST_GROUPS };
        let groups = successive(joint.bundle.placements.len(), most);
        let uncertainty = joint.bundle.uncertainty_of_groups(Loss::Squared, &groups)?;
        let doubts = Doubts::of(&joint, tied.alone, &uncertainty);
        Ok(Self { joint, uncertainty, doubts })
    }
}

/// All cameras of a chain in one world; with time offsets where the frames' times and their corners say that they are needed.
fn together(tied: Tied<'_>, options: &BoardOptions) -> Result<Outcome, BoardError> {
    let Tied { seen, plate, alone, .. } = tied;
    let mut notes = Vec::new();
    let untimed = Solved::of(tied, options);
    let doubtful = match &untimed {
        Ok(solved) => !solved.doubts.is_empty() && !solved.joint.timed,
        Err(error) => out_of_bounds(error).is_some() && !options.time_offsets,
    };
    let timed = (doubtful && has_times(seen))
        .then(|| Solved::of(tied, &BoardOptions { time_offsets: true, ..options.clone() }))
        .and_then(Result::ok)
        .filter(|timed| timed.uncertainty.open.is_empty());
    let mut offsets = None;
    let solved = match (untimed, timed) {
        (Err(error), None) => {
            // What contradicts itself may drive a lens out of bounds.
            let Some(what) = out_of_bounds(&error) else { return Err(error) };
            return Ok(Outcome::Refused(Box::new(Refused { what: vec![what], ..Refused::default() })));
        }
        (Err(_), Some(timed)) => timed,
        (Ok(untimed), None) => untimed,
        (Ok(untimed), Some(timed)) => {
            let tried = Offsets::of(&untimed.joint, &timed.joint);
            let better = timed.doubts.gravest < untimed.doubts.gravest && tried.left_px[1] < tried.left_px[0];
            if better {
                notes.push(format!("the cameras do not run together: {}", tried.sentence()));
            }
            offsets = Some(tried);
            if better { timed } else { untimed }
        }
    };
    let Solved { joint, uncertainty, doubts } = solved;
    let free = joint.bundle.sides.first().zip(uncertainty.sides.first()).filter(|(side, _)| side.free);
    let told = free.and_then(|(side, known)| Told::of(plate, side, known));
    if let Some(told) = told.as_ref().filter(|told| told.vagueness() > 1.0) {
        return Ok(Outcome::BackOpen(told.uncertainty()));
    }
    let modalities: Vec<Modality> = seen.iter().map(|seen| modality(seen)).collect();
    let mut rig = joint.bundle.rig("board", &uncertainty, &modalities);
    if let Some(open) = rig.quality.as_ref().and_then(|quality| quality.open.first()) {
        return Err(BoardError::Open { what: open.clone() });
    }
    if options.time_offsets && !joint.timed {
        notes.push("time offsets were asked for and not estimated: not all frames have times (timestamps.csv)".into());
    }
    if !doubts.is_bearable() {
        let worst = remedies::worst(&joint);
        let (timed, has_times) = (joint.timed, has_times(seen));
        let mut what = causes(tied, options, timed);
        what.extend(doubts.sentences().into_iter().filter(|sentence| !what.contains(sentence)).collect::<Vec<_>>());
        return Ok(Outcome::Refused(Box::new(Refused { what, offsets, timed, has_times, worst })));
    }
    let doubtful = !doubts.is_empty();
    rig.warnings = doubts.sentences();
    rig.warnings.extend(notes);
    rig.warnings.extend(scattered(&joint));
    rig.warnings.extend(told.as_ref().and_then(Told::warning));
    rig.warnings.extend(as_stated(&tied, options));
    for ((camera, one), seen) in rig.cameras.iter_mut().zip(alone).zip(seen) {
        camera.warnings = coverage_warnings(seen);
        // Intrinsics that the last pass kept are as uncertain as the pass before left them.
        if let (true, Some(single)) = (options.keep_intrinsics, &one.single) {
            let alone = single.bundle.rig("board", &single.uncertainty, &[Modality::Rgb]);
            let before = alone.cameras.into_iter().next().and_then(|camera| camera.sigma);
            camera.sigma.get_or_insert_with(Sigma::default).intrinsics = before.unwrap_or_default().intrinsics;
        }
        camera.warnings.extend(focal_warning(camera));
    }
    let mut evidence = Evidence::default();
    for (seen, alone) in seen.iter().zip(alone) {
        if let (Some(_), Some(solution)) = (&alone.single, &alone.solution) {
            evidence.pass(format!("intrinsics of {}", seen.camera), solution);
        }
    }
    for (name, solution) in &joint.passes {
        evidence.pass(*name, solution);
    }
    evidence.observe(&joint.bundle);
    evidence.outlines = outlines(&joint, plate);
    evidence.tables.extend(told.as_ref().map(Told::table));
    evidence.moments = joint.moments;
    if let Some(quality) = &mut rig.quality {
        quality.measures.insert("instants".into(), evidence.moments.len() as f64);
        quality.measures.extend(told.iter().flat_map(Told::measures));
    }
    Ok(Outcome::Rig(Box::new(Fitted { calibrated: (rig, evidence), doubtful })))
}

/// What a contradiction comes from, in words, as it shows where lenses do not bend to hide it.
fn causes(tied: Tied<'_>, options: &BoardOptions, timed: bool) -> Vec<String> {
    let rigid = BoardOptions { keep_intrinsics: true, time_offsets: timed, ..options.clone() };
    Solved::of(tied, &rigid).map_or(Vec::new(), |solved| solved.doubts.causes().collect())
}

/// What drove a lens out of bounds, in words, if that is what went wrong.
fn out_of_bounds(error: &BoardError) -> Option<String> {
    match error {
        BoardError::Bundle(BundleError::Camera { camera, .. }) => {
            Some(format!("no lens of {camera} makes the views fit together"))
        }
        _ => None,
    }
}

/// Says so where a camera's frames come now earlier and now later.
fn scattered(joint: &Joint) -> Option<String> {
    const LEAST_S: f64 = 5e-3;
    let each = joint.bundle.cameras.iter().zip(&joint.scatter_s).filter(|(_, scatter_s)| **scatter_s >= LEAST_S);
    let each: Vec<String> =
        each.map(|(camera, scatter_s)| format!("{} by {:.0} ms", camera.name, 1e3 * scatter_s)).collect();
    (!each.is_empty()).then(|| {
        format!(
            "frame times scatter besides their offsets (standard deviation), so that pictures of a fast board get less weight: {}",
            each.join(", ")
        )
    })
}

/// Says so where the back was not found but taken as it was stated.
fn as_stated(tied: &Tied<'_>, options: &BoardOptions) -> Option<String> {
    let thickness_m = options.back_thickness_m.filter(|_| tied.back.is_some_and(|back| back.stated && back.seen))?;
    Some(format!(
        "where the back of the board is on it does not follow from the views, and is as it was stated: {:.1} mm behind the front, \
         parallel to it, middles and edges one behind the other. Cameras that see the one side are placed against those that see \
         the other no better than the board is glued",
        1e3 * thickness_m
    ))
}

/// Where the boards were, some of them.
fn outlines(joint: &Joint, plate: &Plate) -> Vec<[DVec3; 4]> {
    const MOST: usize = 60;
    let placements = &joint.bundle.placements;
    let every = placements.len().div_ceil(MOST).max(1);
    let outline = |(placement, face): (&Placement, &Face)| {
        let target = plate.target(*face);
        let (columns, rows) = target.corners();
        let corners = [0, columns - 1, columns * rows - 1, columns * (rows - 1)].map(|id| target.point(id));
        let [Some(a), Some(b), Some(c), Some(d)] = corners else { return None };
        Some([a, b, c, d].map(|corner| placement.world(corner)))
    };
    placements.iter().zip(&joint.faces).step_by(every).filter_map(outline).collect()
}

fn modality(seen: &Seen) -> Modality {
    if seen.events { Modality::Event } else { Modality::Rgb }
}

/// A focal length less certain than this share of it is doubtful.
const DOUBTFUL: f64 = 0.01;

/// Says so where the focal length is doubtful.
fn focal_warning(camera: &RigCamera) -> Option<String> {
    let sigma = (*camera.sigma.as_ref()?.intrinsics.get("fx")?)?;
    let share = sigma / camera.intrinsics.fx;
    (share > DOUBTFUL).then(|| {
        format!(
            "its focal length is known only to {:.1} %, which limits its pose; show it the board tilted by 30 degrees and more about \
             both axes",
            100.0 * share
        )
    })
}

/// What a camera's views lack.
fn coverage_warnings(seen: &Seen) -> Vec<String> {
    const GRID: usize = 4;
    let mut coverage = Coverage::new(seen.size, [GRID; 2]);
    seen.views.iter().flat_map(|view| &view.corners).for_each(|corner| coverage.see(corner.pixel));
    let (covered, parts) = (coverage.covered(), coverage.parts());
    let mut warnings = Vec::new();
    if let Some((count, first)) = &seen.unreadable {
        warnings.push(format!("{count} pictures could not be read and were skipped: {first}"));
    }
    if covered < parts * 3 / 4 {
        warnings.push(format!(
            "the board covers {covered} of {parts} parts of the image; distortion is not known where it never was"
        ));
    }
    if seen.views.len() < 10 {
        warnings.push(format!("only {} views of the board; 10 or more are advisable", seen.views.len()));
    }
    warnings
}
