//! From a plan to its jobs: every dataset with every combination of settings and every seed.

use std::{collections::BTreeSet, path::PathBuf};

use super::{
    SweepError,
    manifest::{Job, Preparation, Window},
    plan::{MOST_JOBS, Plan, Take, plain},
};

/// A dataset that is trained.
struct Prepared {
    name: String,
    folder: PathBuf,
    /// How it is made, and which window it is, where it is one.
    window: Option<(Preparation, Window)>,
    /// Which of all datasets it takes over from what stands still.
    after: Option<usize>,
}

/// One value of every option and setting.
#[derive(Clone, Default)]
struct Choice {
    arguments: Vec<String>,
    /// What tells it from others, for the name and the tables.
    settings: Vec<(String, String)>,
}

impl Choice {
    /// Whether what stands still is told from what moves: not by a field that moves everything, as the published methods have it.
    fn tells_what_stands_still(&self) -> bool {
        let fields = ["--preset=paper", "--preset=released-code", "--motion=hexplane"];
        !self.arguments.iter().any(|argument| fields.contains(&argument.as_str()))
    }
}

impl Plan {
    /// The jobs, in an order in which the first seed of everything comes first, so that there is soon something to compare.
    ///
    /// # Errors
    /// [`SweepError::Plan`] if they are too many.
    pub(super) fn jobs(&self) -> Result<Vec<Job>, SweepError> {
        let choices = self.choices()?;
        let datasets = self.prepared();
        let count = choices.len().checked_mul(datasets.len()).and_then(|count| count.checked_mul(self.seeds.len()));
        if count.is_none_or(|count| count > MOST_JOBS) {
            return Err(self.too_many());
        }
        let (mut jobs, mut names): (Vec<Job>, _) = (Vec::new(), BTreeSet::new());
        for &seed in &self.seeds {
            for choice in &choices {
                // The jobs of this choice and seed, as the datasets are.
                let first = jobs.len();
                for Prepared { name, folder, window, after } in &datasets {
                    let settings = choice.settings.iter().map(|(key, value)| {
                        let key = key.rsplit('.').next().unwrap_or(key);
                        // A method is known by its name, a number by what it is the number of.
                        if is_a_name(value) { value.clone() } else { format!("{key}{value}") }
                    });
                    let parts: Vec<String> =
                        [name.clone()].into_iter().chain(settings).chain([format!("s{seed}")]).collect();
                    let name = unused(&plain(&parts.join("-")), &mut names);
                    let mut arguments = choice.arguments.clone();
                    arguments.extend(["--seed".into(), seed.to_string()]);
                    let (preparation, window) = window.clone().unzip();
                    let after = after.filter(|_| choice.tells_what_stands_still());
                    let after = after.map(|dataset| jobs[first + dataset].name.clone());
                    jobs.push(Job {
                        name,
                        dataset: folder.clone(),
                        preparation,
                        window,
                        after,
                        seed,
                        settings: choice.settings.iter().cloned().collect(),
                        arguments,
                    });
                }
            }
        }
        Ok(jobs)
    }

    fn too_many(&self) -> SweepError {
        SweepError::Plan { path: self.out.clone(), message: format!("it asks for more than {MOST_JOBS} runs") }
    }

    /// Every combination.
    fn choices(&self) -> Result<Vec<Choice>, SweepError> {
        let mut choices = vec![Choice::default()];
        let options = self.train.iter().map(|entry| (true, entry));
        for (is_option, (key, value)) in options.chain(self.set.iter().map(|entry| (false, entry))) {
            let varies = value.is_array();
            let values = value.as_array().map_or(std::slice::from_ref(value), Vec::as_slice);
            if choices.len().saturating_mul(values.len()) > MOST_JOBS {
                return Err(self.too_many());
            }
            let with = |choice: &Choice, value: &toml::Value| {
                let mut choice = choice.clone();
                let text = value.as_str().map_or_else(|| value.to_string(), str::to_owned);
                match (is_option, value) {
                    (true, toml::Value::Boolean(true)) => choice.arguments.push(format!("--{key}")),
                    (true, toml::Value::Boolean(false)) => {}
                    (true, _) => choice.arguments.push(format!("--{key}={text}")),
                    (false, _) => choice.arguments.push(format!("--set={key}={text}")),
                }
                if varies {
                    choice.settings.push((key.clone(), text));
                }
                choice
            };
            choices = choices.iter().flat_map(|choice| values.iter().map(|value| with(choice, value))).collect();
        }
        Ok(choices)
    }

    /// The datasets by name, and how those that are windows of a take are made.
    fn prepared(&self) -> Vec<Prepared> {
        let (mut names, mut takes) = (BTreeSet::new(), BTreeSet::new());
        let mut found = Vec::new();
        for folder in &self.datasets {
            let name = folder.file_name().map_or_else(|| "ds".into(), |name| name.to_string_lossy().into_owned());
            let name = unused(&plain(&name), &mut names);
            found.push(Prepared { name, folder: folder.clone(), window: None, after: None });
        }
        for take in &self.takes {
            let stem =
                take.session.file_stem().map_or_else(|| "take".into(), |stem| stem.to_string_lossy().into_owned());
            let (first, take_name) = (found.len(), unused(&plain(&stem), &mut takes));
            for (at, (from, seconds)) in take.windows().into_iter().enumerate() {
                let name = unused(&plain(&format!("{stem}-w{at:03}")), &mut names);
                let folder = self.out.join("datasets").join(&name);
                let window = Window { take: take_name.clone(), from, seconds };
                let after = Some(first).filter(|_| take.one_static_set && at > 0);
                found.push(Prepared { name, folder, window: Some((preparation(take, &window), window)), after });
            }
        }
        found
    }
}

fn preparation(take: &Take, Window { from, seconds, .. }: &Window) -> Preparation {
    let path = |path: &PathBuf| path.to_string_lossy().into_owned();
    let mut import: Vec<String> = ["dataset", "import", "session"].map(String::from).into();
    import.extend([path(&take.session), "--rig".into(), path(&take.rig)]);
    import.extend([format!("--from={from}"), format!("--seconds={seconds}")]);
    import.extend(take.import.iter().cloned());
    Preparation { import, undistort: take.undistort, points: take.points.clone() }
}

fn is_a_name(value: &str) -> bool {
    value.parse::<f64>().is_err() && !matches!(value, "true" | "false") && !value.starts_with('[')
}

/// `name`, or with a number where it is taken.
fn unused(name: &str, taken: &mut BTreeSet<String>) -> String {
    let mut own = name.to_owned();
    for number in 2.. {
        if taken.insert(own.clone()) {
            break;
        }
        own = format!("{name}-{number}");
    }
    own
}
