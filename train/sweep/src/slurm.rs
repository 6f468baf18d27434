//! Slurm: the array of jobs, and what its queue says of them.
//!
//! A task of the array is `erfgs sweep OUT --job NAME` under `srun`, which hands it the request to stop that Slurm sends before
//! a preemption and before the end of a job's time. It then saves its checkpoint and ends with exit code 130, upon which the
//! script puts the task back into the queue: not every cluster is set up to do that by itself (`RequeueExit=130`).

use std::{
    collections::{BTreeMap, BTreeSet},
    io,
    path::{Path, PathBuf},
    process::Command,
    time::Duration,
};

use erfgs_base::{FileError, children::answer};
use serde::{Deserialize, Serialize};

use super::{
    SweepError,
    manifest::{Manifest, write_json},
    shell::{self, one_line, quoted},
    status::{JobState, Queue},
};

/// Tasks of one array. Slurm's own limit is 1001 unless it is set up otherwise.
const TASKS: usize = 1000;
/// Seconds between the request to stop and the end of a job's time, unless the plan says otherwise.
const GRACE_SECONDS: u32 = 120;

/// How long a controller may take to answer. Without a configuration Slurm's programs try for a minute.
const PING_PATIENCE: Duration = Duration::from_secs(10);
/// How long a command of Slurm may take: a controller that has much to do lets them try for a minute.
const PATIENCE: Duration = Duration::from_secs(180);
/// Bytes that one may print: a hundred of each of 600,000 tasks.
const MOST_BYTES: usize = 64 << 20;

/// An array that was submitted.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Submission {
    /// Its id.
    pub id: u64,
    /// The jobs of its tasks, from task 0 on.
    pub jobs: Vec<String>,
}

/// Whether there is a Slurm here.
///
/// # Errors
/// A sentence, where one is installed and no controller of it answers.
pub fn answers() -> Result<bool, String> {
    let mut ping = Command::new("scontrol");
    ping.arg("ping");
    match answer(ping, PING_PATIENCE, MOST_BYTES) {
        Err(error) if error.kind() != io::ErrorKind::TimedOut => Ok(false),
        Ok(output) if output.status.success() && output.out.contains("UP") => Ok(true),
        _ => Err("Slurm is installed here, but no controller of it answers (`scontrol ping`)".into()),
    }
}

/// The scripts of the arrays in which `jobs` are submitted.
///
/// # Errors
/// [`SweepError::Line`] if a name or a folder has a line break.
pub fn scripts(manifest: &Manifest, jobs: &[String], program: &Path) -> Result<Vec<String>, SweepError> {
    jobs.chunks(TASKS).map(|jobs| script(manifest, jobs, program)).collect()
}

fn pages_script(manifest: &Manifest, program: &Path) -> Result<String, SweepError> {
    let head = head(manifest, "-pages", "slurm-pages-%j.log", &[])?;
    Ok(format!("{head}srun --ntasks=1 {}\n", shell::line(&own_words(manifest, program, ["--pages".into()]))))
}

fn script(manifest: &Manifest, jobs: &[String], program: &Path) -> Result<String, SweepError> {
    let options = &manifest.slurm;
    let at_once = options.at_once.map(|count| format!("%{}", count.max(1))).unwrap_or_default();
    let more = [
        format!("--array=0-{}{at_once}", jobs.len().saturating_sub(1)),
        format!("--signal=TERM@{}", options.grace.unwrap_or(GRACE_SECONDS)),
    ];
    let mut text = head(manifest, "", "slurm-%A_%a.log", &more)?;
    text += "jobs=(\n";
    for job in jobs {
        text += &format!("  {}\n", quoted(job));
    }
    let words = own_words(manifest, program, ["--job".into()]);
    text += &format!(
        ")\n\
         srun --ntasks=1 {} \"${{jobs[$SLURM_ARRAY_TASK_ID]}}\"\n\
         code=$?\n\
         # Stopped in good order: it goes on when there is room again.\n\
         if [ $code -eq 130 ]; then\n\
         \x20 scontrol requeue \"${{SLURM_ARRAY_JOB_ID}}_$SLURM_ARRAY_TASK_ID\"\n\
         fi\n\
         exit $code\n",
        shell::line(&words),
    );
    Ok(text)
}

/// The beginning of a script: options of `sbatch`, the sweep's own, `more` and the plan's, and the plan's lines before a job. Each of
/// them is one line.
fn head(manifest: &Manifest, suffix: &str, log: &str, more: &[String]) -> Result<String, SweepError> {
    let log = manifest.folder.join("logs").join(log);
    let log = one_line("the folder of the sweep", &log.to_string_lossy()).map(quoted)?;
    let name = one_line("the name of the sweep", &manifest.name).map(quoted)?;
    let mut text = format!(
        "#!/bin/bash\n\
         #SBATCH --job-name={name}{suffix}\n\
         #SBATCH --output={log}\n\
         #SBATCH --open-mode=append\n\
         #SBATCH --requeue\n",
    );
    for option in more.iter().chain(&manifest.slurm.options) {
        text += &format!("#SBATCH {}\n", one_line("the entry of slurm.options", option)?);
    }
    text.push('\n');
    for line in &manifest.slurm.setup {
        text += &format!("{}\n", one_line("the entry of slurm.setup", line)?);
    }
    Ok(text)
}

/// The words of a command of this program in a sweep's folder.
fn own_words<const N: usize>(manifest: &Manifest, program: &Path, more: [String; N]) -> Vec<String> {
    let text = |path: &Path| path.to_string_lossy().into_owned();
    [text(program), "sweep".into(), text(&manifest.folder)].into_iter().chain(more).collect()
}

/// Submits the jobs that are neither done nor in the queue, and says what was submitted.
///
/// # Errors
/// [`SweepError`] if Slurm refuses.
pub fn submit(manifest: &Manifest, program: &Path) -> Result<Vec<Submission>, SweepError> {
    let queue = queue(manifest)?;
    let wanted = |job: &&super::Job| !queue.contains_key(&job.name) && !manifest.is_done(job);
    // Those that wait for others come in arrays of their own, after these.
    let (first, later): (Vec<&super::Job>, Vec<_>) =
        manifest.jobs.iter().filter(wanted).partition(|job| manifest.is_ready(job));
    let names = |jobs: &[&super::Job]| -> Vec<String> { jobs.iter().map(|job| job.name.clone()).collect() };
    let befores: BTreeSet<&String> = later.iter().filter_map(|job| job.after.as_ref()).collect();
    let logs = manifest.folder.join("logs");
    std::fs::create_dir_all(&logs).map_err(FileError::when("create the folder", &logs))?;
    let (mut all, mut new) = (submissions(manifest)?, Vec::new());
    for (jobs, waits) in [(names(&first), false), (names(&later), true)] {
        for (jobs, script) in std::iter::zip(jobs.chunks(TASKS), scripts(manifest, &jobs, program)?) {
            let path = manifest.folder.join(format!("jobs-{}.sh", all.len()));
            erfgs_base::atomic::write(&path, script.as_bytes()).map_err(FileError::when("write", &path))?;
            let mut words = vec!["--parsable".into()];
            if waits {
                // However they end: what cannot begin then says why. Each of them was submitted last where it still is.
                let last = |job: &&String| all.iter().rev().find(|of: &&Submission| of.jobs.contains(job));
                let ids: BTreeSet<String> = befores.iter().filter_map(last).map(|of| of.id.to_string()).collect();
                let ids = Vec::from_iter(ids).join(":");
                words.extend((!ids.is_empty()).then(|| format!("--dependency=afterany:{ids}")));
            }
            words.push(path.to_string_lossy().into_owned());
            let answer = ask("sbatch", &words)?;
            // `123`, or `123;cluster`.
            let id = answer.trim().split(';').next().and_then(|id| id.parse().ok());
            let id = id.ok_or_else(|| SweepError::Answer { command: "sbatch".into(), answer: answer.trim().into() })?;
            let submission = Submission { id, jobs: jobs.to_vec() };
            all.push(submission.clone());
            new.push(submission);
            // After each: what Slurm has is known, whatever happens next.
            write_json(&record(manifest), &all)?;
        }
    }
    if !new.is_empty() && !manifest.takes().is_empty() {
        submit_pages(manifest, program, &all)?;
    }
    Ok(new)
}

/// Submits the job that writes the pages of takes, after all that are in the queue.
fn submit_pages(manifest: &Manifest, program: &Path, all: &[Submission]) -> Result<(), SweepError> {
    let queue = queue(manifest)?;
    let waits = |of: &&Submission| of.jobs.iter().any(|job| queue.contains_key(job));
    let ids: Vec<String> = all.iter().filter(waits).map(|of| of.id.to_string()).collect();
    let path = manifest.folder.join("pages.sh");
    let text = pages_script(manifest, program)?;
    erfgs_base::atomic::write(&path, text.as_bytes()).map_err(FileError::when("write", &path))?;
    let mut words = vec!["--parsable".into()];
    words.extend((!ids.is_empty()).then(|| format!("--dependency=afterany:{}", ids.join(":"))));
    words.push(path.to_string_lossy().into_owned());
    ask("sbatch", &words).map(drop)
}

/// What Slurm's queue says of the jobs of a sweep.
///
/// # Errors
/// [`SweepError::Slurm`] if it does not answer.
pub fn queue(manifest: &Manifest) -> Result<Queue, SweepError> {
    let submissions = submissions(manifest)?;
    if submissions.is_empty() {
        return Ok(Queue::new());
    }
    let words = ["--noheader", "--array", "--me", "--format=%F %K %T"].map(String::from);
    Ok(read_queue(&submissions, &ask("squeue", &words)?))
}

/// Reads lines of array, task and state.
fn read_queue(submissions: &[Submission], answer: &str) -> Queue {
    let of: BTreeMap<u64, &Submission> = submissions.iter().map(|submission| (submission.id, submission)).collect();
    let mut queue = Queue::new();
    for line in answer.lines() {
        let mut fields = line.split_whitespace();
        let (Some(id), Some(task), Some(state)) = (fields.next(), fields.next(), fields.next()) else { continue };
        let submission = id.parse().ok().and_then(|id: u64| of.get(&id));
        let job = task.parse().ok().and_then(|task: usize| submission?.jobs.get(task));
        let state = match state {
            "RUNNING" | "COMPLETING" | "STOPPED" | "SUSPENDED" | "SIGNALING" | "STAGE_OUT" | "CONFIGURING" => {
                JobState::Running
            }
            "PENDING" | "REQUEUED" | "REQUEUE_HOLD" | "REQUEUE_FED" | "SPECIAL_EXIT" | "RESV_DEL_HOLD" | "RESIZING" => {
                JobState::Queued
            }
            // What has ended stays in the list for some minutes.
            _ => continue,
        };
        if let Some(job) = job {
            queue.insert(job.clone(), state);
        }
    }
    queue
}

fn record(manifest: &Manifest) -> PathBuf {
    manifest.folder.join("slurm.json")
}

/// What was submitted. What cannot be read is no reason to submit it again.
fn submissions(manifest: &Manifest) -> Result<Vec<Submission>, SweepError> {
    let path = record(manifest);
    let text = match erfgs_base::text::read(&path) {
        Ok(text) => text,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err(FileError::when("read", &path)(error).into()),
    };
    serde_json::from_str(&text).map_err(|error| SweepError::Record { path, what: error.to_string() })
}

fn ask(command: &str, words: &[String]) -> Result<String, SweepError> {
    ask_within(command, words, PATIENCE)
}

fn ask_within(command: &str, words: &[String], patience: Duration) -> Result<String, SweepError> {
    let failed = |message: String| SweepError::Slurm { command: format!("{command} {}", words.join(" ")), message };
    let mut asked = Command::new(command);
    asked.args(words);
    let output = answer(asked, patience, MOST_BYTES).map_err(|error| match error.kind() {
        io::ErrorKind::TimedOut if command == "sbatch" => failed(format!(
            "{error}; whether it submitted anything `squeue --me` says: cancel that before you try again"
        )),
        _ => failed(error.to_string()),
    })?;
    if !output.status.success() {
        return Err(failed(output.errors.trim().to_owned()));
    }
    Ok(output.out)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn manifest(folder: &Path) -> Manifest {
        let text = r#"{"format": "erfgs-sweep", "version": 1, "name": "s", "evaluate": true, "jobs": [],
            "slurm": {"options": ["--partition=gpu"], "setup": ["module load vulkan"], "at_once": 3, "grace": null}}"#;
        std::fs::write(folder.join("sweep.json"), text).unwrap();
        Manifest::load(folder).unwrap()
    }

    #[test]
    fn a_program_that_does_not_answer_is_given_up() {
        let asked = |program: &str, words: &[&str], ms| {
            let words: Vec<String> = words.iter().map(|word| (*word).to_owned()).collect();
            ask_within(program, &words, Duration::from_millis(ms)).map_err(|error| error.to_string())
        };
        assert_eq!(asked("echo", &["12"], 60_000), Ok("12\n".into()));
        // A queue of thousands of tasks is more than a pipe holds.
        assert!(asked("seq", &["100000"], 60_000).is_ok_and(|queue| queue.ends_with("100000\n")));
        for (program, words, what) in [("sleep", "1000", "did not end within"), ("cat", "no/such/file", "no/such/file")]
        {
            let error = asked(program, &[words], 50).unwrap_err();
            assert!(error.contains(what) && error.contains(program), "{error}");
        }
    }

    #[test]
    fn what_was_submitted_and_cannot_be_read_is_not_submitted_again() {
        let folder = tempfile::tempdir().unwrap();
        let manifest = manifest(folder.path());
        assert!(queue(&manifest).unwrap().is_empty());
        std::fs::write(record(&manifest), "[{\"id\": 1, \"jobs\"").unwrap();
        for error in [queue(&manifest).unwrap_err(), submit(&manifest, Path::new("erfgs")).unwrap_err()] {
            let error = error.to_string();
            assert!(error.contains("slurm.json") && error.contains("squeue --me"), "{error}");
        }
    }

    #[test]
    fn a_script_has_the_plans_options_and_words_that_a_shell_leaves_alone() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("it's here");
        std::fs::create_dir(&out).unwrap();
        let jobs: Vec<String> = (0..1200).map(|n| format!("ds-s{n}")).collect();
        let scripts = scripts(&manifest(&out), &jobs, Path::new("/opt/my programs/erfgs")).unwrap();
        assert_eq!(scripts.len(), 2, "an array has 1000 tasks at most");
        assert!(scripts[0].contains("#SBATCH --array=0-999%3\n") && scripts[1].contains("#SBATCH --array=0-199%3\n"));
        for line in ["#SBATCH --partition=gpu", "module load vulkan", "#SBATCH --signal=TERM@120", "  ds-s1000"] {
            assert!(scripts[1].lines().any(|own| own == line), "{line}\n{}", scripts[1]);
        }
        // A shell reads it, and takes the names for one word each.
        let script = format!(
            "{}\necho \"${{#jobs[@]}}\"",
            scripts[1].split("srun").next().unwrap().replace("module", "# module")
        );
        let output = Command::new("bash").args(["-c", &script]).output().unwrap();
        assert_eq!(String::from_utf8_lossy(&output.stdout).trim(), "200");
        let quoted = scripts[1]
            .lines()
            .find(|line| line.starts_with("srun"))
            .unwrap()
            .replace("srun --ntasks=1", "printf '%s|'");
        let output =
            Command::new("bash").args(["-c", &format!("jobs=(a); SLURM_ARRAY_TASK_ID=0; {quoted}")]).output().unwrap();
        let words = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(
            words.starts_with("/opt/my programs/erfgs|sweep|") && words.ends_with("/it's here|--job|a|"),
            "{words}"
        );
    }

    /// Nothing of a plan or of a manifest becomes a line of its own.
    #[test]
    fn what_would_be_a_line_of_the_script_is_refused_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let jobs = ["a".to_owned()];
        let program = Path::new("erfgs");
        let refused = |manifest: &Manifest| match scripts(manifest, &jobs, program) {
            Err(SweepError::Line { what, .. }) if pages_script(manifest, program).is_err() => what,
            other => panic!("{other:?}"),
        };
        let whole = manifest(folder.path());
        let mut out = whole.clone();
        out.folder = folder.path().join("a\nrm -r x");
        assert_eq!(refused(&out), "the folder of the sweep");
        let mut name = whole.clone();
        name.name = "a\nrm -r x".into();
        assert_eq!(refused(&name), "the name of the sweep");
        let mut option = whole.clone();
        option.slurm.options.push("--partition=a\nrm -r x".into());
        assert_eq!(refused(&option), "the entry of slurm.options");
        let mut setup = whole.clone();
        setup.slurm.setup.push("true\rrm".into());
        assert_eq!(refused(&setup), "the entry of slurm.setup");
        // A program may lie anywhere: the shell is given its name as one word.
        assert!(scripts(&whole, &jobs, Path::new("/opt/a\nb/erfgs")).is_ok());
    }

    #[test]
    fn the_queue_is_read_for_our_own_arrays_alone() {
        let submissions = [
            Submission { id: 7, jobs: vec!["a".into(), "b".into(), "c".into()] },
            Submission { id: 9, jobs: vec!["d".into()] },
        ];
        let answer =
            "7 0 RUNNING\n7 1 PENDING\n7 2 FAILED\n8 0 RUNNING\n9 0 REQUEUED\n9 1 RUNNING\nN/A\n7 N/A PENDING\n";
        let queue = read_queue(&submissions, answer);
        let states: Vec<_> = queue.iter().map(|(job, state)| format!("{job} {}", state.name())).collect();
        assert_eq!(states, ["a running", "b queued", "d queued"]);
    }
}
