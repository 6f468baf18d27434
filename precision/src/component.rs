//! A component, its knobs, and what came of each setting.

use std::{
    panic::{AssertUnwindSafe, catch_unwind},
    sync::Arc,
};

use serde::{Deserialize, Serialize};

use crate::{Bench, Kept, Refusal, Stopwatch};

/// What any of the libraries may say against a setting.
pub type Result<T> = std::result::Result<T, Refusal>;

/// A kind of error.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Measure {
    /// What it is.
    pub name: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// Whether it spans orders of magnitude and is never zero: its axis is logarithmic then.
    pub logarithmic: bool,
}

/// What a component is, in words.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct About {
    /// Its name.
    pub name: &'static str,
    /// What is run and what its errors are told from.
    pub truth: &'static str,
    /// What the processor time is of.
    pub work: &'static str,
    /// The kinds of error. The first one judges.
    pub measures: &'static [Measure],
}

type Run = dyn Fn(&Bench, &mut Stopwatch) -> Result<Vec<f64>> + Send + Sync;

/// A numerical component with its knobs.
#[derive(Clone)]
pub struct Component {
    /// What it is.
    pub about: About,
    /// One curve a knob.
    pub curves: Vec<Curve<usize>>,
    /// What there is to run. Curves share what they have in common.
    runs: Vec<Work>,
}

#[derive(Clone)]
struct Work {
    /// About how long it takes.
    weight: f64,
    /// What is set, in words that no other setting has.
    setting: String,
    run: Arc<Run>,
}

/// The settings of one knob, from one end to the other.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Curve<T> {
    /// What is turned.
    pub knob: String,
    /// Its settings.
    pub places: Vec<Place<T>>,
}

/// A setting of a knob.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Place<T> {
    /// What the knob is set to.
    pub setting: String,
    /// Whether this is where the program has it.
    pub default: bool,
    /// What came of it.
    pub came: T,
}

/// What a setting cost and what it left.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Spent {
    /// The error of each measure.
    pub errors: Vec<f64>,
    /// Processor time of all threads, seconds: the median of the runs.
    pub cpu_seconds: f64,
    /// The quickest and the slowest run, seconds of processor time.
    pub cpu_range: [f64; 2],
    /// The clock on the wall, seconds.
    pub wall_seconds: f64,
    /// How many runs that is of.
    pub runs: usize,
}

/// What the settings of a component came to.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Outcome {
    /// The component.
    pub about: About,
    /// Its curves; what could not be run has the reason.
    pub curves: Vec<Curve<std::result::Result<Spent, String>>>,
}

impl std::fmt::Debug for Component {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Component").field("about", &self.about).field("curves", &self.curves).finish_non_exhaustive()
    }
}

impl Component {
    /// About how long it takes, in units of a quick setting.
    #[must_use]
    pub fn weight(&self) -> f64 {
        self.runs.iter().map(|work| work.weight).sum()
    }

    /// Runs every setting once for all curves that share it, but for what is kept. `advance` is told the weight of what is done.
    #[must_use]
    pub fn run(&self, bench: &Bench, enough: f64, kept: &mut Kept, mut advance: impl FnMut(f64)) -> Outcome {
        let mut done = 0.0;
        let came: Vec<_> = self
            .runs
            .iter()
            .map(|Work { weight, setting, run }| {
                advance(done);
                done += weight;
                if let Some(spent) = kept.get(self.about.name, setting) {
                    return Ok(spent);
                }
                let came = spend(run, bench, enough, self.about.measures.len());
                came.inspect(|spent| kept.add(self.about.name, setting, spent))
            })
            .collect();
        let place = |place: &Place<usize>| Place {
            setting: place.setting.clone(),
            default: place.default,
            came: came[place.came].clone(),
        };
        let curve =
            |curve: &Curve<usize>| Curve { knob: curve.knob.clone(), places: curve.places.iter().map(place).collect() };
        Outcome { about: self.about, curves: self.curves.iter().map(curve).collect() }
    }
}

/// A panic is a refusal like any other, so that what comes after it still runs.
fn spend(run: &Arc<Run>, bench: &Bench, enough: f64, measures: usize) -> std::result::Result<Spent, String> {
    let mut stopwatch = Stopwatch::new(enough);
    let errors = match catch_unwind(AssertUnwindSafe(|| run(bench, &mut stopwatch))) {
        Ok(Ok(errors)) => errors,
        Ok(Err(refusal)) => return Err(refusal.to_string()),
        Err(_) => return Err("it panicked".into()),
    };
    if errors.len() != measures || !errors.iter().all(|error| error.is_finite()) {
        return Err(format!("its errors are {errors:?}"));
    }
    let (cpu_seconds, wall_seconds, runs) = stopwatch.median();
    Ok(Spent { errors, cpu_seconds, cpu_range: stopwatch.range(), wall_seconds, runs })
}

impl Outcome {
    /// What could not be run: knob, setting and reason.
    pub fn refused(&self) -> impl Iterator<Item = [&str; 3]> {
        let places = self.curves.iter().flat_map(|curve| curve.places.iter().map(move |place| (curve, place)));
        places.filter_map(|(curve, place)| {
            let why = place.came.as_ref().err()?;
            Some([curve.knob.as_str(), place.setting.as_str(), why])
        })
    }
}

type Judge<C> = dyn Fn(&Bench, &mut Stopwatch, &C) -> Result<Vec<f64>> + Send + Sync;

/// A component in the making, by configurations of type `C`.
pub struct Study<C> {
    about: About,
    curves: Vec<Curve<usize>>,
    configurations: Vec<C>,
    run: Arc<Judge<C>>,
    weigh: fn(&C) -> f64,
}

impl<C: Clone + PartialEq + std::fmt::Debug + Send + Sync + 'static> Study<C> {
    /// A component that `run` runs with a configuration and judges: the errors in the order of its measures.
    pub fn new(
        about: About,
        run: impl Fn(&Bench, &mut Stopwatch, &C) -> Result<Vec<f64>> + Send + Sync + 'static,
    ) -> Self {
        Self { about, curves: Vec::new(), configurations: Vec::new(), run: Arc::new(run), weigh: |_| 1.0 }
    }

    /// Tells about how long a configuration takes, in units of a quick one.
    #[must_use]
    pub fn weighing(mut self, weigh: fn(&C) -> f64) -> Self {
        self.weigh = weigh;
        self
    }

    /// A knob: what it may be set to, of which `default` is where the program has it.
    #[must_use]
    pub fn knob<S: Into<String>>(
        mut self,
        knob: impl Into<String>,
        default: &C,
        settings: impl IntoIterator<Item = (S, C)>,
    ) -> Self {
        let places = settings
            .into_iter()
            .map(|(setting, configuration)| {
                let default = configuration == *default;
                let known = self.configurations.iter().position(|known| *known == configuration);
                let came = known.unwrap_or_else(|| {
                    self.configurations.push(configuration);
                    self.configurations.len() - 1
                });
                Place { setting: setting.into(), default, came }
            })
            .collect();
        self.curves.push(Curve { knob: knob.into(), places });
        self
    }

    /// The component.
    #[must_use]
    pub fn component(self) -> Component {
        let runs = self.configurations.into_iter().map(|configuration| {
            let run = self.run.clone();
            let (weight, setting) = ((self.weigh)(&configuration), format!("{configuration:?}"));
            let run: Arc<Run> = Arc::new(move |bench, stopwatch| run(bench, stopwatch, &configuration));
            Work { weight, setting, run }
        });
        Component { about: self.about, curves: self.curves, runs: runs.collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_knobs_have_in_common_is_run_once_and_the_default_is_marked() {
        const ABOUT: About = About { name: "a", truth: "", work: "", measures: &[] };
        let study = Study::new(ABOUT, |_, _, _: &(u8, u8)| Ok(Vec::new()))
            .knob("first", &(1, 1), [("0", (0, 1)), ("1", (1, 1)), ("2", (2, 1))])
            .knob("second", &(1, 1), [("1", (1, 1)), ("5", (1, 5))]);
        let component = study.component();
        assert_eq!((component.runs.len(), component.weight()), (4, 4.0));
        let marked = |curve: &Curve<usize>| curve.places.iter().map(|place| place.default).collect::<Vec<_>>();
        assert_eq!(
            component.curves.iter().map(marked).collect::<Vec<_>>(),
            [vec![false, true, false], vec![true, false]]
        );
        assert_eq!(component.curves[1].places[0].came, component.curves[0].places[1].came);
    }
}
