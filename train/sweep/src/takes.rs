//! Long takes, as their windows were trained.

use super::manifest::{Job, Manifest, Window};

/// A take, as one choice of settings and one seed trained it.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainedTake<'a> {
    /// What its runs are called, without the number of the window.
    pub name: String,
    /// The windows that are done, one after another.
    pub windows: Vec<TrainedWindow<'a>>,
    /// How many are not.
    pub missing: usize,
}

/// A window of a take that is done. Times are seconds of the session.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainedWindow<'a> {
    /// Its job.
    pub job: &'a Job,
    /// Where it begins.
    pub begins: f64,
    /// From when on it is shown...
    pub from: f64,
    /// ...and until when: two windows part in the middle of what both know.
    pub until: f64,
}

impl Manifest {
    /// The takes of more than one window.
    #[must_use]
    pub fn takes(&self) -> Vec<TrainedTake<'_>> {
        let mut groups: Vec<Vec<(&Job, &Window)>> = Vec::new();
        for (job, window) in self.jobs.iter().filter_map(|job| Some((job, job.window.as_ref()?))) {
            let of = |(job, window): &(&Job, &Window)| (window.take.clone(), job.seed, job.settings.clone());
            let own = of(&(job, window));
            match groups.iter_mut().find(|group| of(&group[0]) == own) {
                Some(group) => group.push((job, window)),
                None => groups.push(vec![(job, window)]),
            }
        }
        groups.iter().filter(|group| group.len() > 1).map(|group| self.take(group)).collect()
    }

    fn take<'a>(&'a self, group: &[(&'a Job, &'a Window)]) -> TrainedTake<'a> {
        let window = |(job, Window { from, seconds, .. }): &(&'a Job, &'a Window)| {
            // A window begins with its first frame.
            let manifest = self.run(job).read_dataset().ok();
            let spans = manifest.and_then(|manifest| Some((manifest.provenance.zero_ns?, manifest.span_ns)));
            let [begins, until] = spans.map_or([*from, from + seconds], |(zero_ns, [start, end])| {
                [start, end].map(|t_ns| 1e-9 * (zero_ns + t_ns) as f64)
            });
            TrainedWindow { job, begins, from: begins, until }
        };
        let mut windows: Vec<TrainedWindow<'_>> =
            group.iter().filter(|(job, _)| self.is_done(job)).map(window).collect();
        windows.sort_by(|a, b| a.begins.total_cmp(&b.begins));
        for at in 1..windows.len() {
            let (before, next) = (windows[at - 1].until, windows[at].from);
            if next < before {
                (windows[at - 1].until, windows[at].from) = (0.5 * (before + next), 0.5 * (before + next));
            }
        }
        TrainedTake { name: group[0].0.name.replacen("-w000", "", 1), missing: group.len() - windows.len(), windows }
    }
}
