//! `erfgs sweep`: on this machine, and on a Slurm whose nodes die.

use std::{
    collections::BTreeMap,
    fs,
    path::Path,
    process::{Command, Stdio},
    time::{Duration, Instant},
};

use super::{Folder, slurm::Cluster};

/// What is the same in every test: a small training that can be compared byte for byte.
const PLAN: &str = r#"
datasets = ["ds"]
seeds = [1, 2, 3]
evaluate = false
[train]
method = "4dgs"
iterations = "20+100"
deterministic = true
no-evaluation = true
[set]
"evaluation.log_every" = 2
"evaluation.checkpoint_minutes" = 0.003
"density.from" = 5
"density.every" = 10
"#;

fn plan(folder: &Folder, name: &str, text: &str) {
    fs::write(folder.path(name), text).expect("a plan");
}

/// The states of the jobs by their names.
fn states(status: &serde_json::Value) -> BTreeMap<String, String> {
    let jobs = status["jobs"].as_array().expect("jobs");
    let text = |value: &serde_json::Value| value.as_str().expect("text").to_owned();
    jobs.iter().map(|job| (text(&job["name"]), text(&job["state"]))).collect()
}

fn wait(what: &str, mut there: impl FnMut() -> bool) {
    let until = Instant::now() + Duration::from_secs(120);
    while !there() {
        assert!(Instant::now() < until, "waited too long for {what}");
        std::thread::sleep(Duration::from_millis(100));
    }
}

/// Rows of a run's curve.
fn rows(run: &Path) -> usize {
    fs::read_to_string(run.join("curve.csv")).map_or(0, |text| text.lines().count().saturating_sub(1))
}

#[test]
fn what_a_plan_asks_for_is_told_and_what_is_wrong_with_it_is_named() {
    let folder = Folder::with_stage("ds");
    let text = PLAN.replace("method = \"4dgs\"", "method = [\"4dgs\", \"erf-gs\"]") + "\"earl.weight\" = [0.5, 2]\n";
    plan(&folder, "plan.toml", &text);
    let listing = folder.figures("sweep plan.toml --dry-run --local");
    let jobs = listing["jobs"].as_array().expect("jobs");
    let names: Vec<&str> = jobs.iter().filter_map(|job| job["name"].as_str()).collect();
    assert_eq!(names.len(), 12, "{names:?}");
    assert_eq!(
        names[..4],
        ["ds-4dgs-weight0.5-s1", "ds-4dgs-weight2-s1", "ds-erf-gs-weight0.5-s1", "ds-erf-gs-weight2-s1"]
    );
    let arguments: Vec<&str> =
        jobs[3]["arguments"].as_array().expect("words").iter().filter_map(|w| w.as_str()).collect();
    for word in ["--method=erf-gs", "--set=earl.weight=2", "--deterministic", "--seed", "1"] {
        assert!(arguments.contains(&word), "{word} in {arguments:?}");
    }
    assert!(!folder.path("plan").exists(), "a dry run writes nothing");
    // A Slurm that is asked for and is not there, or does not answer.
    let output = folder.command("sweep plan.toml --slurm").env("SLURM_CONF", "nowhere.conf").output().expect("erfgs");
    let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.code() == Some(2) && stderr.contains("Slurm") && !folder.path("plan").exists(), "{stderr}");

    for (from, to, expected) in [
        ("log_every", "log_evry", "no field 'evaluation.log_evry'"),
        ("[\"ds\"]", "[\"nowhere\"]", "no dataset.json"),
        ("seeds = [1, 2, 3]", "seeds = []", "'seeds' is an empty list"),
        ("seeds", "sedes", "unknown field `sedes`"),
        ("method = \"4dgs\"", "method = \"5dgs\"", "invalid value '5dgs'"),
        ("method = \"4dgs\"", "out = \"x\"", "[train] has 'out'"),
        ("iterations = \"20+100\"", "minutes = 3", "cannot be used with"),
    ] {
        plan(&folder, "wrong.toml", &PLAN.replacen(from, to, 1));
        let stderr = folder.fail(1, "sweep wrong.toml --dry-run --local").replace('`', "'");
        assert!(stderr.contains(&expected.replace('`', "'")), "{expected}: {stderr}");
    }
    // All runs would make the points at once.
    let manifest = folder.path("ds/dataset.json");
    let mut value: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(&manifest).expect("a manifest")).expect("JSON");
    value["points"] = serde_json::Value::Null;
    fs::write(&manifest, value.to_string()).expect("written");
    assert!(folder.fail(1, "sweep plan.toml --local").contains("erfgs dataset points"));
    assert!(folder.fail(1, "sweep ds --status").contains("no sweep.json"));
}

#[test]
fn windows_of_a_take_cover_it_and_overlap() {
    let folder = Folder::new();
    let text = "seeds = [4]\n[[take]]\nsession = \"take1.mcap\"\nrig = \"rig.json\"\nfrom = 1.0\nseconds = 10\nwindow = 4\noverlap = 1\n";
    plan(&folder, "long.toml", text);
    let listing = folder.figures("sweep long.toml --dry-run --local");
    let windows: Vec<String> = listing["jobs"]
        .as_array()
        .expect("jobs")
        .iter()
        .map(|job| {
            let words = job["preparation"]["import"].as_array().expect("words");
            let of =
                |option: &str| words.iter().filter_map(|word| word.as_str()?.strip_prefix(option)).collect::<String>();
            format!("{} {}+{}", job["name"].as_str().expect("a name"), of("--from="), of("--seconds="))
        })
        .collect();
    assert_eq!(windows, ["take1-w000-s4 1+4", "take1-w001-s4 4+4", "take1-w002-s4 7+4"]);
}

#[cfg(unix)]
#[test]
fn a_sweep_here_is_stopped_and_gone_on_with_and_a_failure_costs_its_own_run() {
    let folder = Folder::with_stage("ds");
    super::copy(&folder.path("ds"), &folder.path("broken"));
    let text = PLAN.replace("[\"ds\"]", "[\"ds\", \"broken\"]").replace("[1, 2, 3]", "[1]");
    plan(&folder, "plan.toml", &text);
    fs::remove_dir_all(folder.path("broken/images")).expect("removed");

    let mut sweep = folder.command("sweep plan.toml --local --quiet").stdout(Stdio::null()).spawn().expect("erfgs");
    wait("a training that runs", || rows(&folder.path("plan/runs/ds-s1")) >= 12);
    assert_eq!(states(&folder.figures("sweep plan.toml --local --status"))["ds-s1"], "running");
    let sent = Command::new("kill").args(["-TERM", &sweep.id().to_string()]).status().expect("kill");
    assert!(sent.success());
    assert_eq!(sweep.wait().expect("an end").code(), Some(130));
    let status = folder.figures("sweep plan.toml --local --status");
    assert_eq!(states(&status)["ds-s1"], "stopped", "{status}");
    assert!(folder.path("plan/runs/ds-s1/checkpoint.bin").is_file(), "what ran was saved");
    assert!(folder.fail(2, "report plan --no-view --out report.html").contains("no run of the sweep is done"));

    let stderr = folder.fail(1, "sweep plan.toml --local --at-once 2");
    assert!(stderr.contains("1 of 2 runs failed"), "{stderr}");
    let status = folder.figures("sweep plan --local --status");
    assert_eq!(
        (states(&status)["ds-s1"].as_str(), states(&status)["broken-s1"].as_str()),
        ("done", "failed"),
        "{status}"
    );
    let why = status["jobs"].as_array().expect("jobs").iter().find_map(|job| job["failed"].as_str()).expect("a reason");
    assert!(why.contains("`erfgs train` ended with"), "{why}");
    let report = folder.figures("report plan --no-view --out report.html");
    assert_eq!(report["runs"].as_array().map(Vec::len), Some(1), "{report}");
    assert!(report["notes"].to_string().contains("1 of 2 runs are done"), "{report}");
}

/// Files of a sweep are written whole or not at all; a disk, an editor or another version damages them all the same.
#[test]
fn a_damaged_file_is_named_and_nothing_is_trained_over_it() {
    let folder = Folder::with_stage("ds");
    plan(&folder, "plan.toml", &PLAN.replace("[1, 2, 3]", "[1]").replace("20+100", "5+10"));
    let sweep = "sweep plan.toml --local";
    let [record, run] = ["plan/jobs/ds-s1.json", "plan/runs/ds-s1"].map(|name| folder.path(name));
    let damages = |whole: &str| {
        let newer = whole
            .replace("\"format_version\": 1", "\"format_version\": 999")
            .replace("\"attempts\": ", "\"attempts\": -");
        [String::new(), whole[..whole.len() / 2].to_owned(), "attempts = 1".to_owned(), "[]".to_owned(), newer]
    };
    // Before it was begun.
    fs::create_dir_all(folder.path("plan/jobs")).expect("a folder");
    for damaged in damages("{\"attempts\": 1, \"node\": \"\"}") {
        fs::write(&record, damaged).expect("written");
        let stderr = folder.fail(1, sweep);
        assert!(stderr.contains("1 of 1 runs failed"), "{stderr}");
        let status = folder.figures("sweep plan --local --status");
        let why = status["jobs"][0]["failed"].as_str().expect("a reason");
        assert!(why.contains("jobs/ds-s1.json") && why.contains("remove it"), "{why}");
        assert!(!run.exists(), "nothing was trained");
    }
    fs::remove_file(&record).expect("removed");
    folder.figures(sweep);
    let trained = fs::read(run.join("checkpoint.bin")).expect("a checkpoint");

    // What is done stays done, and its record is told of.
    fs::write(&record, "{").expect("written");
    let status = folder.figures(sweep);
    assert_eq!(states(&status)["ds-s1"], "done", "{status}");
    assert!(status["jobs"][0]["failed"].to_string().contains("jobs/ds-s1.json"), "{status}");
    fs::remove_file(&record).expect("removed");
    let info = fs::read_to_string(run.join("run.json")).expect("a description");
    for damaged in damages(&info) {
        fs::write(run.join("run.json"), &damaged).expect("written");
        let stderr = folder.fail(1, sweep);
        assert!(stderr.contains("1 of 1 runs failed"), "{stderr}");
        let status = folder.figures("sweep plan --local --status");
        let why = status["jobs"][0]["failed"].as_str().expect("a reason");
        assert!(why.contains("ds-s1/run.json") && why.contains("remove"), "{why}");
        assert_eq!(fs::read_to_string(run.join("run.json")).expect("the same"), damaged);
    }
    // As the message says: nothing is trained again.
    fs::remove_file(run.join("run.json")).expect("removed");
    assert_eq!(states(&folder.figures(sweep))["ds-s1"], "done");
    assert!(fs::read(run.join("checkpoint.bin")).expect("a checkpoint") == trained);

    // A finished training whose checkpoint is gone is not begun again, and neither is a sweep of a newer program.
    fs::remove_file(run.join("checkpoint.bin")).expect("removed");
    for resume in ["", " --resume"] {
        let stderr = folder.fail(2, &format!("train ds --out plan/runs/ds-s1 --method 4dgs --iterations 5+10{resume}"));
        assert!(stderr.contains("finished training") && stderr.contains("checkpoint.bin"), "{stderr}");
    }
    let manifest = folder.path("plan/sweep.json");
    let newer = fs::read_to_string(&manifest).expect("a manifest").replace("\"version\": 1", "\"version\": 2");
    fs::write(&manifest, &newer).expect("written");
    for words in [sweep, "sweep plan --local --status"] {
        let stderr = folder.fail(1, words);
        assert!(stderr.contains("sweep.json") && stderr.contains("version 2"), "{stderr}");
    }
    assert_eq!(fs::read_to_string(&manifest).expect("the same"), newer);
}

#[cfg(target_os = "linux")]
#[test]
fn a_dead_node_and_a_preempted_job_lose_nothing() {
    let folder = Folder::with_stage("ds");
    // Long enough for two faults.
    let text = PLAN.replace("20+100", "20+400");
    plan(&folder, "here.toml", &text);
    plan(&folder, "there.toml", &text);
    let cluster = Cluster::start();
    let sweep = |words: &str| {
        let mut command = folder.command(words);
        let output = command.env("SLURM_CONF", cluster.configuration()).output().expect("erfgs");
        let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "erfgs {words}: {stderr}");
        serde_json::from_slice::<serde_json::Value>(&output.stdout).expect("JSON")
    };
    let status = sweep("sweep there.toml --slurm --json");
    assert_eq!(states(&status).len(), 3, "{status}");
    let run = |seed: u32| folder.path(&format!("there/runs/ds-s{seed}"));
    // The first two seeds run, each on a node; both have come to their first checkpoint.
    wait("two runs with a checkpoint", || [1, 2].iter().all(|&seed| run(seed).join("checkpoint.bin").exists()));
    let nodes = ["n1", "n2"];
    assert_eq!(cluster.stdout("squeue", "-h -t RUNNING -o %N").lines().count(), nodes.len());
    // What is in the queue is not submitted again.
    let again = sweep("sweep there.toml --slurm --json");
    assert_eq!(cluster.stdout("squeue", "-h -r -o %F").lines().count(), 3, "{again}");
    cluster.kill_node("n2");
    cluster.preempt("n1");
    wait("all runs", || {
        cluster.hurry();
        states(&sweep("sweep there.toml --slurm --status --json")).values().all(|state| state == "done")
    });
    let status = sweep("sweep there --slurm --status --json");
    let starts: Vec<u64> =
        status["jobs"].as_array().expect("jobs").iter().filter_map(|job| job["attempts"].as_u64()).collect();
    assert!(
        starts[0] >= 2 && starts[1] >= 2,
        "the run of the dead node and the preempted one were started again: {status}"
    );

    // The same without a fault, on this machine.
    sweep("sweep here.toml --local --at-once 2 --json");
    for seed in 1..=3 {
        let read = |sweep: &str| {
            fs::read(folder.path(&format!("{sweep}/runs/ds-s{seed}/checkpoint.bin"))).expect("a checkpoint")
        };
        assert!(read("here") == read("there"), "seed {seed} came to another end");
    }
    a_window_waits_for_the_first_and_the_page_for_both(&folder, &sweep);
}

/// Two windows that are one dataset here.
#[cfg(target_os = "linux")]
fn a_window_waits_for_the_first_and_the_page_for_both(folder: &Folder, sweep: &dyn Fn(&str) -> serde_json::Value) {
    use serde_json::{Value, json};
    let text = fs::read_to_string(folder.path("there/sweep.json")).expect("a manifest");
    let mut manifest: Value = serde_json::from_str(&text).expect("JSON");
    let job = |number: u32, after: Option<&str>| {
        let mut job = manifest["jobs"][0].clone();
        job["name"] = format!("ds-w00{number}-s1").into();
        job["window"] = json!({ "take": "ds", "from": 0.2 * f64::from(number), "seconds": 0.3 });
        job["after"] = after.into();
        job["arguments"] = json!(["--motion=still", "--iterations=10+10", "--no-evaluation"]);
        job
    };
    manifest["jobs"] = json!([job(0, None), job(1, Some("ds-w000-s1"))]);
    fs::create_dir(folder.path("windows")).expect("a folder");
    fs::write(folder.path("windows/sweep.json"), manifest.to_string()).expect("a manifest");
    sweep("sweep windows --slurm --json");
    wait("the page of the take", || folder.path("windows/takes/ds-s1.html").exists());
    let status = sweep("sweep windows --slurm --status --json");
    assert!(states(&status).values().all(|state| state == "done"), "{status}");
    let starts = status["jobs"][1]["attempts"].as_u64();
    assert_eq!(starts, Some(1), "it did not begin before it could: {status}");
    let log = fs::read_to_string(folder.path("windows/logs/ds-w001-s1.log")).expect("a log");
    assert!(log.contains("--static") && log.contains("of the static set"), "{log}");
}
