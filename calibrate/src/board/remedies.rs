//! What would make a rig of recordings that contradict themselves: each remedy is tried, and the refusal says which helped.

use std::collections::BTreeSet;

use super::{
    BoardError, BoardOptions,
    joint::Joint,
    rig::{Failed, Fitted, Several},
};
use crate::statistics::median;

/// Instants whose residuals are so many times those of half of all are the worst.
const WORST: f64 = 3.0;
/// A greater share of the instants is not left out.
const MOST_WORST: f64 = 0.25;
/// With more cameras each is not left out in turn.
const MOST_CAMERAS: usize = 8;

/// A solution that is none.
#[derive(Default)]
pub(super) struct Refused {
    /// What speaks against it, in sentences, causes first.
    pub what: Vec<String>,
    /// What time offsets gave where they were tried by themselves.
    pub offsets: Option<Offsets>,
    /// Whether offsets are in it.
    pub timed: bool,
    /// Whether all frames have times.
    pub has_times: bool,
    /// The instants that fit worst.
    pub worst: Vec<String>,
}

/// A solution with time offsets beside one without.
pub(super) struct Offsets {
    /// The greatest offset, seconds.
    most_s: f64,
    /// What each leaves over, without and with them, pixels.
    pub left_px: [f64; 2],
}

impl Offsets {
    pub fn of(without: &Joint, with: &Joint) -> Self {
        let each = with.bundle.cameras.iter().map(|camera| camera.time_offset_s.abs());
        Self { most_s: each.fold(0.0, f64::max), left_px: [without.rms_px(None), with.rms_px(None)] }
    }

    pub fn sentence(&self) -> String {
        let [without, with] = self.left_px;
        format!(
            "time offsets of up to {:.0} ms were estimated: the residual is {with:.2} px instead of {without:.2} px",
            1e3 * self.most_s
        )
    }
}

impl Refused {
    /// The error, with what came of what was tried.
    pub fn error(self, tried: Tried) -> BoardError {
        let times = match (self.timed, self.has_times) {
            (true, _) => "",
            (false, true) => "the frames are simultaneous (--time-offsets did not help),  ",
            (false, false) => {
                "the frames are simultaneous (free-running cameras need a timestamps.csv, and --time-offsets),  "
            }
        };
        BoardError::Contradiction {
            what: self.what.into_iter().take(4).collect::<Vec<_>>().join("; "),
            tried: tried.sentences.join("; "),
            lenses: tried.lenses,
            times: times.into(),
        }
    }
}

/// The instants whose corners lie farthest from where they should; none where no few of them stand out.
pub(super) fn worst(joint: &Joint) -> Vec<String> {
    let mut sums = vec![(0.0, 0.0); joint.moments.len()];
    for observation in &joint.bundle.observations {
        if let Some(left_px) = joint.beyond_timing(observation) {
            let sum = &mut sums[observation.placement];
            *sum = (sum.0 + left_px * left_px, sum.1 + 1.0);
        }
    }
    let rms: Vec<f64> = sums.iter().map(|(squares, count)| f64::sqrt(squares / f64::max(*count, 1.0))).collect();
    let typical = median(rms.iter().copied()).unwrap_or(0.0);
    let far = rms.iter().zip(&joint.moments).filter(|(rms, _)| **rms > WORST * typical);
    let names: BTreeSet<String> = far.map(|(_, moment)| moment.name.clone()).collect();
    if names.len() as f64 > MOST_WORST * joint.moments.len() as f64 { Vec::new() } else { names.into_iter().collect() }
}

/// What was tried, and what came of it.
#[derive(Default)]
pub(super) struct Tried {
    /// In sentences.
    sentences: Vec<String>,
    /// Whether holding the lenses helps, so that better ones will.
    lenses: bool,
}

/// Tries what may help; `report` gets what is tried. A camera is left out only where nothing else helps.
pub(super) fn tried(several: &Several<'_>, refused: &Refused, options: &BoardOptions, report: &dyn Fn(&str)) -> Tried {
    let mut tried = Tried::default();
    if let Some(offsets) = &refused.offsets {
        tried.sentences.push(format!("{}, which is not enough", offsets.sentence()));
    }
    let mut helps = |words: &str, options: &BoardOptions| {
        report(words);
        let outcome = several.calibrate(options);
        tried.sentences.push(verdict(words, &outcome));
        outcome.is_ok_and(|fitted| !fitted.doubtful)
    };
    let keep = BoardOptions { keep_intrinsics: true, ..options.clone() };
    let lenses_are_free = !options.keep_intrinsics && several.alone.iter().any(|alone| alone.single.is_some());
    let lenses = lenses_are_free && helps(KEEP, &keep);
    let mut helped = lenses;
    if !refused.worst.is_empty() {
        let untied: BTreeSet<String> = options.untied.iter().chain(&refused.worst).cloned().collect();
        let words = untied.iter().map(|instant| format!("--untie {instant}")).collect::<Vec<_>>().join(" ");
        let untie = |options: &BoardOptions| BoardOptions { untied: untied.clone(), ..options.clone() };
        helped |= helps(&words, &untie(options));
        helped = helped || (lenses_are_free && helps(&format!("{KEEP} {words}"), &untie(&keep)));
    }
    if !helped {
        tried.sentences.extend(without_one(several, options, report));
    }
    Tried { lenses, ..tried }
}

const KEEP: &str = "--keep-intrinsics";

/// What leaving out each camera in turn gives, as far as it helps.
fn without_one(several: &Several<'_>, options: &BoardOptions, report: &dyn Fn(&str)) -> Vec<String> {
    let count = several.seen.len();
    if !(3..=MOST_CAMERAS).contains(&count) {
        return Vec::new();
    }
    let without = |left_out: usize| {
        let others = || (0..count).filter(|index| *index != left_out);
        let seen: Vec<_> = others().map(|index| several.seen[index]).collect();
        let alone: Vec<_> = others().map(|index| several.alone[index]).collect();
        let words = format!("--without {}", several.seen[left_out].camera);
        report(&words);
        (words, Several { seen: &seen, alone: &alone, plate: several.plate }.calibrate(options))
    };
    let all: Vec<_> = (0..count).map(without).filter(|(_, outcome)| outcome.is_ok()).collect();
    let is_sound =
        |(_, outcome): &&(String, Result<Fitted, Failed>)| outcome.as_ref().is_ok_and(|fitted| !fitted.doubtful);
    // Rigs that are doubtful are named only where there is no other.
    let any_sound = all.iter().any(|trial| is_sound(&trial));
    let helpful: Vec<String> = all
        .iter()
        .filter(|trial| !any_sound || is_sound(trial))
        .map(|(words, outcome)| verdict(words, outcome))
        .collect();
    if helpful.is_empty() { vec!["leaving out any one camera does not help".into()] } else { helpful }
}

fn verdict(words: &str, outcome: &Result<Fitted, Failed>) -> String {
    match outcome {
        Ok(Fitted { calibrated: (rig, _), .. }) => {
            let left_px = rig.quality.as_ref().map_or(0.0, |quality| quality.rms_px);
            let doubt = rig.warnings.first().map_or(String::new(), |doubt| format!(", with the warning: {doubt}"));
            format!("{words} gives a rig (residual {left_px:.2} px{doubt})")
        }
        Err(Failed::Refused(refused)) => {
            format!("{words} does not help{}", refused.what.first().map_or(String::new(), |what| format!(" ({what})")))
        }
        Err(Failed::Other(error)) => format!("{words} does not help ({error})"),
    }
}
