//! The report of run folders that look like real ones.

mod fake;

use std::{fs, path::Path};

use erfgs_dataset::PoseSigma;
use erfgs_report::{Extras, ReportError, write_report};
use erfgs_run::{RunError, RunFolder};
use fake::Kind;

const BASELINE: Kind = Kind { method: "4dgs", lag: 5.0, events: false };
const EVENTS: Kind = Kind { method: "erf-gs", lag: 1.5, events: true };

/// Two complete runs and their page.
fn compared(root: &Path) -> (Vec<RunFolder>, String) {
    let runs = vec![fake::write(&root.join("4dgs"), &BASELINE), fake::write(&root.join("erf-gs"), &EVENTS)];
    let page = page(&runs, root);
    (runs, page)
}

fn page(runs: &[RunFolder], root: &Path) -> String {
    let out = root.join("report.html");
    let report = write_report(runs, Extras::default(), &out).unwrap();
    let page = fs::read_to_string(&out).unwrap();
    assert_eq!(page.len() as u64, report.bytes);
    assert_well_formed(&page);
    page
}

/// Every element is closed in order, and nothing is fetched.
fn assert_well_formed(page: &str) {
    const VOID: [&str; 5] = ["meta", "img", "br", "!doctype", "link"];
    let mut open: Vec<&str> = Vec::new();
    let body = page.find("<style>").unwrap() + "<style>".len();
    let after_style = body + page[body..].find("</style>").unwrap() + "</style>".len();
    for part in [&page[..body - "<style>".len()], &page[after_style..]] {
        for tag in part.split('<').skip(1) {
            let inside = tag.split('>').next().unwrap();
            let name = inside.split([' ', '/', '\n']).next().unwrap();
            if let Some(closed) = inside.strip_prefix('/') {
                assert_eq!(open.pop(), Some(closed), "near '<{}'", &tag.chars().take(80).collect::<String>());
            } else if !inside.ends_with('/') && !VOID.contains(&name) {
                open.push(name);
            }
        }
    }
    assert!(open.is_empty(), "{open:?}");
    for fetched in ["http://", "https://", "url(", "<script", "<link", "@import"] {
        assert!(!page.contains(fetched), "the page fetches or runs something: {fetched}");
    }
    for source in page.split("src=\"").skip(1) {
        assert!(source.starts_with("data:image/"), "{}", source.chars().take(40).collect::<String>());
    }
}

#[test]
fn an_oracle_tells_what_events_make_up_for() {
    let folder = tempfile::tempdir().unwrap();
    let (runs, plain) = compared(folder.path());
    let heading = "Share of the gap that events close";
    assert!(!plain.contains(heading));
    let oracle = fake::write(&folder.path().join("all-frames"), &Kind { method: "4dgs", lag: 0.0, events: false });
    let out = folder.path().join("report.html");
    write_report(&runs, Extras { oracle: Some(&oracle), ..Extras::default() }, &out).unwrap();
    let page = fs::read_to_string(&out).unwrap();
    assert_well_formed(&page);
    // Between frames the fake runs have 18.1, 21.6 and 23.1 dB.
    assert!(page.contains(heading) && page.contains("all-frames") && page.contains(">70 %<"), "{heading}");
    let report = write_report(&runs[..1], Extras { oracle: Some(&oracle), ..Extras::default() }, &out).unwrap();
    assert!(report.notes.iter().any(|note| note.contains("cannot be used")), "{:?}", report.notes);
    fs::remove_file(oracle.metrics_file()).unwrap();
    assert!(matches!(
        write_report(&runs, Extras { oracle: Some(&oracle), ..Extras::default() }, &out),
        Err(ReportError::Run(RunError::Missing { .. }))
    ));
}

#[test]
fn two_runs_make_one_page_with_every_section() {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("report");
    let (runs, text) = compared(&folder);
    let sections =
        ["summary", "curves", "time", "pictures", "events", "views", "left-out", "losses", "configuration", "dataset"];
    for section in sections {
        assert!(text.contains(&format!("<section id=\"{section}\">")), "{section}");
    }
    for expected in ["DPSNR (motion masks)", "no weights", "Worst DPSNR", "earl.enabled", "llvmpipe", "208 s"] {
        assert!(text.contains(expected), "{expected}");
    }
    assert!(!text.contains("<aside"), "nothing to beware of");
    // 3 views of truth, mask and detail, and of render, error map and detail of two runs; 2 x 2 event frames.
    assert_eq!(text.matches("<img ").count(), 3 * 3 * 3 + 2 * 2);
    assert_eq!(text, page(&runs, &folder), "the same runs give the same bytes");
}

#[test]
fn what_a_stopped_run_lacks_is_noted_and_the_rest_is_shown() {
    let folder = tempfile::tempdir().unwrap();
    let (mut runs, _) = compared(folder.path());
    let stopped = fake::write(&folder.path().join("stopped"), &EVENTS);
    for file in [stopped.metrics_file(), stopped.per_view_file(), stopped.dataset_file()] {
        fs::remove_file(file).unwrap();
    }
    let curve = fs::read(stopped.curve_file()).unwrap();
    fs::write(stopped.curve_file(), &curve[..curve.len() - 9]).unwrap();
    for index in 0..25 {
        fs::write(runs[1].render_file("cam00", index).unwrap(), b"not a picture").unwrap();
    }
    runs.push(stopped);
    let text = page(&runs, folder.path());
    for expected in
        ["stopped: not evaluated yet", "curve.csv was cut off", "dataset.json", "could not be shown", "Best DPSNR"]
    {
        assert!(text.contains(expected), "{expected}");
    }
}

#[test]
fn what_a_calibration_tells_of_its_errors_is_shown() {
    let folder = tempfile::tempdir().unwrap();
    let (runs, before) = compared(folder.path());
    assert!(!before.contains("± mm"));
    let mut manifest = fake::manifest();
    manifest.cameras[2].pose_sigma = Some(PoseSigma { centre_m: [3e-4, 0.0, 4e-4], rotation_deg: [0.0, 0.012, 0.005] });
    manifest.cameras[2].clock_sigma_s = Some(12.34e-6);
    runs[0].write_dataset(&manifest).unwrap();
    let page = page(&runs, folder.path());
    let row = page.split("<tr>").find(|row| row.starts_with("<th>cam02</th><td>RGB</td>")).unwrap();
    let cells = [">0.50<", ">0.013<", ">12.3<"];
    assert!(page.contains("± mm") && cells.iter().all(|cell| row.contains(cell)), "{row}");
}

#[test]
fn pictures_are_chosen_among_those_that_were_kept() {
    let folder = tempfile::tempdir().unwrap();
    let (runs, _) = compared(folder.path());
    for view in runs[0].read_per_view().unwrap().iter().filter(|view| view.index != 6) {
        fs::remove_file(runs[0].render_file(&view.camera, view.index).unwrap()).unwrap();
    }
    let text = page(&runs, folder.path());
    // Two cameras at one time are left: worst and best.
    assert_eq!(text.matches(", frame 6 <small>").count(), 2);
    assert!(!text.contains("<aside"));
}

#[test]
fn a_run_that_only_began_gives_a_page() {
    let folder = tempfile::tempdir().unwrap();
    let run = RunFolder::new(folder.path().join("run"));
    run.write_info(&Default::default()).unwrap();
    let text = page(&[run], folder.path());
    assert!(text.contains("not evaluated yet") && text.contains("no curve.csv"));
}

#[test]
fn runs_over_different_datasets_are_kept_apart() {
    let folder = tempfile::tempdir().unwrap();
    let (runs, _) = compared(folder.path());
    let mut info = runs[1].read_info().unwrap();
    info.dataset_sha256 = Some("00".repeat(32));
    info.dataset_name = "another".into();
    runs[1].write_info(&info).unwrap();
    let text = page(&runs, folder.path());
    assert!(text.contains("different datasets (thrown-ball-dv, another)"));
    for part in ["<section id=\"scenes\">", "<section id=\"scene-1-summary\">", "<section id=\"scene-2-summary\">"] {
        assert!(text.contains(part), "{part}");
    }
    assert!(!text.contains("class=\"findings\""), "nothing is compared across datasets");
}

#[test]
fn markup_in_files_is_shown_and_not_run() {
    let folder = tempfile::tempdir().unwrap();
    let (runs, _) = compared(folder.path());
    let evil = "<script>alert('x')</script>\"><img src=x onerror=alert(1)>";
    let mut info = runs[0].read_info().unwrap();
    info.left_out[0].why = evil.into();
    (info.method, info.preset, info.adapter, info.dataset_name) = (evil.into(), evil.into(), evil.into(), evil.into());
    runs[0].write_info(&info).unwrap();
    let mut dataset = fake::manifest();
    (dataset.name, dataset.cameras[1].name) = (evil.into(), evil.into());
    (dataset.provenance.name, dataset.variant[0].step) = (evil.into(), evil.into());
    runs[0].write_dataset(&dataset).unwrap();
    runs[0].write_config(&format!("\"{}\" = \"<b>\"", evil.replace('"', "\\\""))).unwrap();
    let mut views = runs[1].read_per_view().unwrap();
    views[0].camera = "<i>../cam".into();
    runs[1].write_per_view(&views).unwrap();
    let text = page(&runs, folder.path());
    for markup in ["<script", "<img src=x", "<i>"] {
        assert!(!text.contains(markup), "{markup}");
    }
    assert!(text.contains("&lt;script&gt;"));
}

#[test]
fn broken_input_is_an_error_that_names_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("report.html");
    assert!(matches!(write_report(&[], Extras::default(), &out), Err(ReportError::NoRuns)));
    let missing = RunFolder::new(folder.path().join("nowhere"));
    assert!(matches!(
        write_report(&[missing], Extras::default(), &out),
        Err(ReportError::Run(RunError::NotARun { .. }))
    ));

    let run = fake::write(&folder.path().join("run"), &BASELINE);
    fs::write(run.metrics_file(), "{\"psnr\": ").unwrap();
    let message = write_report(std::slice::from_ref(&run), Extras::default(), &out).unwrap_err().to_string();
    assert!(message.contains("metrics.json") && message.contains("erfgs eval"), "{message}");
    assert!(!out.exists(), "no half page is left");
}
