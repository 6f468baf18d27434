//! Bodies: what moves as a few things, each with a path, a way of turning and a shape of its own.
//!
//! The moving points of the initial cloud are hulls of all that moves, one for each instant. Connected pieces of them are chained into
//! tracks through the instants (`detections`, `chains`), points go to the nearest track and centres follow them (`centres`); what flies
//! freely bounces at times that its places tell (`flight`); what falls as other things do is told by few places, and pieces of its hull that are
//! followed by themselves are left out (`crumbs`). A path goes through the centres that is smooth between bounces (`path`).
//! Hulls are deeper than what they are of where views are from one side (`slim`); what is round is a ball, where its silhouettes are
//! discs (`round`). How a thing turns is told by the colours of frames (`shades`; of a ball, in all directions, `globe`) and by its events, which are sharp if they are moved back rightly (`contrast`, `near_events`); `spin` weighs both for one
//! rate, `stretches` for one between two bounces, and `varying` for rates that change. What the user corrects comes between tracks and
//! rotations (`edits`). With its motion known, a thing is carved in its own frame by the silhouettes of all instants (`carve`). Rates
//! that are a little wrong add up: so it is followed by its own looks from the instant at which it is seen best (`grow`). With that shape
//! its events are looked at again (`refine`), which tell how it gets from one instant to the next.

mod carve;
mod centres;
mod chains;
mod close;
mod contrast;
mod crumbs;
mod curve;
mod descend;
mod detections;
mod draft;
mod edits;
mod film;
mod flight;
mod globe;
mod grow;
mod light;
mod looks;
mod mixture;
mod near_events;
mod normals;
mod parts;
mod path;
mod refine;
mod report;
mod round;
mod shades;
mod slim;
mod smooth;
mod spin;
mod stretches;
mod things;
mod thrown;
mod tops;
mod turn;
mod varying;

use std::{collections::BTreeMap, fmt};

use erfgs_calibrate::statistics::median;
use erfgs_dataset::{Bodies, BodiesFile, Body, Dataset};
use serde_json::{Value, json};

use self::{
    curve::Curve,
    draft::Draft,
    film::Film,
    globe::Globes,
    near_events::{Subject, Windows},
    report::Shown,
    shades::Shades,
    spin::rounded,
    things::{Thing, Things},
    varying::Evidence,
};
pub use self::{
    edits::{BodyEdits, SplitBody, TurnBody},
    spin::noted_rate,
};
use crate::CloudError;

/// With fewer points than this at most instants, how a thing turns is not asked of frames.
const FEWEST_POINTS_THAT_TURN: f64 = 60.0;

/// What the finding of bodies is busy with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum BodyStep {
    /// Reading frames and making silhouettes.
    Frames,
    /// Tracks of moving points.
    Tracks,
    /// Reading events near what moves.
    Events,
    /// How bodies turn.
    Rotation,
    /// Shapes of bodies.
    Shapes,
}

impl fmt::Display for BodyStep {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Frames => "frames",
            Self::Tracks => "tracks",
            Self::Events => "events",
            Self::Rotation => "rotation",
            Self::Shapes => "shapes",
        })
    }
}

/// Is told how far the finding of bodies has come: the step, and how many of its items are done. May be called from several threads.
pub type BodyProgress<'a> = &'a (dyn Fn(BodyStep, usize, usize) + Sync);

/// What is to be found, and told of it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BodyOptions {
    /// What the user corrects of what was found.
    pub edits: BodyEdits,
    /// Whether a page is made that shows what was found.
    pub page: bool,
}

/// The bodies of a dataset and how they were found.
#[derive(Clone, Debug, PartialEq)]
pub struct FoundBodies {
    /// The bodies.
    pub bodies: Vec<Body>,
    /// What was counted on the way, for the manifest: instants, moving points, and those that no body explains.
    pub parameters: BTreeMap<String, Value>,
    /// HTML that shows what was found, if it was asked for.
    pub page: Option<String>,
}

/// Finds what moves as bodies, by the moving points of the initial cloud, frames and events.
///
/// # Errors
/// No initial points of what moves, nothing that could be followed, corrections that cannot be made, frames or events that cannot be
/// read: see [`CloudError`].
pub fn find_bodies(
    dataset: &Dataset,
    options: &BodyOptions,
    progress: BodyProgress<'_>,
) -> Result<FoundBodies, CloudError> {
    let film = Film::read(dataset, &|done, total| progress(BodyStep::Frames, done, total))?;
    progress(BodyStep::Tracks, 0, 1);
    let things = Things::new(&film, &options.edits)?;
    progress(BodyStep::Tracks, 1, 1);
    let finder = Finder { dataset, film: &film, options, progress };
    let (drafts, curves) = finder.drafts(&things)?;
    let unshaped = things.all.len() - drafts.len();
    let bodies = finder.bodies(drafts)?;
    if bodies.is_empty() {
        return Err(CloudError::NoBodies { instants: film.moments.len() });
    }
    let [points, nobodys] = things.points();
    let mut parameters = BTreeMap::from([
        ("instants".into(), json!(film.moments.len())),
        ("spacing_m".into(), json!(rounded(film.cell_m, 5))),
        ("moving_points".into(), json!(points)),
        ("moving_points_without_body".into(), json!(nobodys)),
        ("tracks_without_shape".into(), json!(unshaped)),
    ]);
    if options.edits != BodyEdits::default() {
        parameters.insert("edits".into(), json!(options.edits));
    }
    let shown = Shown { film: &film, things: &things, bodies: &bodies, curves: &curves };
    let page = options.page.then(|| report::page(&dataset.manifest.name, &shown));
    Ok(FoundBodies { bodies, parameters, page })
}

struct Finder<'a> {
    dataset: &'a Dataset,
    film: &'a Film,
    options: &'a BodyOptions,
    progress: BodyProgress<'a>,
}

impl<'a> Finder<'a> {
    /// How things turn, what shapes they have by that, and curves of that by names if a page is asked for.
    fn drafts(&self, things: &'a Things) -> Result<(Vec<Draft<'a>>, BTreeMap<&'a str, Curve>), CloudError> {
        let film = self.film;
        let of_thing = |(number, thing): (usize, &'a Thing)| thing.subjects(film, number);
        let subjects: Vec<Subject<'_>> = things.all.iter().enumerate().flat_map(of_thing).collect();
        let windows = self.windows(&subjects, things.all.len())?;
        let (mut drafts, mut curves) = (Vec::new(), BTreeMap::new());
        for (index, (thing, windows)) in std::iter::zip(&things.all, &windows).enumerate() {
            (self.progress)(BodyStep::Rotation, index, things.all.len());
            let shapes = &thing.shapes;
            let usual = median(shapes.iter().map(|shape| shape.places.len() as f64)).unwrap_or(0.0);
            let shades = if usual >= FEWEST_POINTS_THAT_TURN { Shades::new(film, &thing.slim) } else { None };
            let globes = Globes::longer_and_longer(&thing.globes);
            let compared = Globes::with(&globes, shades.as_ref());
            // Two instants do not tell how often it turned between them, and events of what is plain are as sharp by any rate.
            let enough = thing.shapes.len() > 2;
            let all: Vec<_> = windows.values().filter(|_| enough).flatten().collect();
            let mut spin = spin::spin(&compared, &all, self.film.step_s());
            if let Some(curve) = self.options.page.then(|| Curve::new(&spin, compared.last().copied(), &all)).flatten()
            {
                curves.insert(thing.name.as_str(), curve);
            }
            let rates = if let Some(rate) = thing.rate {
                spin.rate = rate;
                spin.found_by.insert("rotation".into(), json!("as was said"));
                None
            } else if let Some((best, rates)) = stretches::turning(film, thing, windows, self.film.step_s()) {
                spin = best;
                Some(rates)
            } else if thing.flies() {
                None
            } else {
                let instants = shapes.iter().map(|shape| (shape.moment, film.moments[shape.moment].t_s)).collect();
                varying::varying(&Evidence { shades: shades.as_ref(), windows, instants }, spin.rate)
            };
            (self.progress)(BodyStep::Shapes, index, things.all.len());
            drafts.extend(Draft::new(film, thing, windows, spin, rates));
        }
        Ok((drafts, curves))
    }

    /// Bodies by a second look at events, which knows their shapes.
    fn bodies(&self, drafts: Vec<Draft<'_>>) -> Result<Vec<Body>, CloudError> {
        let count = drafts.len();
        let again = {
            let of_shapes = drafts.iter().enumerate();
            let of_shapes =
                of_shapes.flat_map(|(number, draft)| draft.subjects(self.film, 2 * number, self.film.step_s()));
            self.windows(&of_shapes.collect::<Vec<_>>(), 2 * count)?
        };
        let body = |(index, (mut draft, windows)): (usize, (Draft<'_>, &[Windows; 2]))| {
            (self.progress)(BodyStep::Shapes, index, count);
            draft.look_again(self.film, windows);
            draft.body(self.film)
        };
        let bodies = std::iter::zip(drafts, again.as_chunks().0).enumerate().map(body).collect();
        (self.progress)(BodyStep::Shapes, count, count);
        Ok(bodies)
    }

    fn windows(&self, subjects: &[Subject<'_>], things: usize) -> Result<Vec<Windows>, CloudError> {
        let reading = |done, total| (self.progress)(BodyStep::Events, done, total);
        near_events::windows(self.dataset, self.film, subjects, things, &reading)
    }
}

/// Writes `bodies.json` into the dataset's folder and names it in the manifest, which is saved.
///
/// # Errors
/// When a file cannot be written.
pub fn attach_bodies(dataset: &mut Dataset, found: &FoundBodies) -> Result<BodiesFile, CloudError> {
    dataset.replace_bodies(&Bodies::new(found.bodies.clone()), found.parameters.clone())?;
    let count = found.bodies.len() as u64;
    Ok(BodiesFile { file: Bodies::FILE.into(), count, parameters: found.parameters.clone() })
}
