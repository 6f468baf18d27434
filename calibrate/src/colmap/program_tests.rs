use super::*;
use crate::colmap::{Extraction, Triangulation};

fn extraction(folder: &Path) -> Extraction {
    Extraction {
        database: folder.join("database.db"),
        images: folder.join("images"),
        list: folder.join("list.txt"),
        names: vec!["0/0.png".into()],
        camera_params: "1,1,1,1".into(),
        threads: 2,
        max_image_size: 640,
        max_features: 100,
        peak_threshold: 0.01,
        edge_threshold: 10.0,
    }
}

fn triangulation(folder: &Path) -> Triangulation {
    Triangulation {
        database: folder.join("database.db"),
        images: folder.join("images"),
        input: folder.join("input"),
        output: folder.join("output"),
        threads: -1,
        max_error_px: 4.0,
        min_ray_angle_deg: 1.5,
    }
}

/// A stand-in for the program: answers as `version` would, writes down its arguments, and ends with `status`.
#[cfg(unix)]
fn stand_in(folder: &Path, version: &str, flags: &[&str], status: i32) -> PathBuf {
    use std::os::unix::fs::PermissionsExt;

    let flags: String = flags.iter().map(|flag| format!("  --{flag} arg (=0)\n")).collect();
    let path = folder.join("colmap");
    let script = format!(
        "#!/bin/sh\nif [ \"$1\" = help ]; then echo '{version}'; exit 0; fi\nif [ \"$2\" = --help ]; then cat <<'X'\n\
         {flags}X\nexit 0; fi\nprintf '%s\\n' \"$@\" > '{}'\necho 'Processed file [1/2]'\necho 'the last word' >&2\n\
         exit {status}\n",
        folder.join("arguments").display()
    );
    std::fs::write(&path, script).unwrap();
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).unwrap();
    path
}

#[cfg(unix)]
const COMMON: [&str; 21] = [
    "database_path",
    "image_path",
    "image_list_path",
    "input_path",
    "output_path",
    "clear_points",
    "ImageReader.camera_model",
    "ImageReader.camera_params",
    "ImageReader.single_camera_per_folder",
    "SiftExtraction.max_num_features",
    "SiftExtraction.peak_threshold",
    "SiftExtraction.edge_threshold",
    "Mapper.extract_colors",
    "Mapper.num_threads",
    "Mapper.ba_refine_focal_length",
    "Mapper.ba_refine_principal_point",
    "Mapper.ba_refine_extra_params",
    "Mapper.filter_max_reproj_error",
    "Mapper.filter_min_tri_angle",
    "Mapper.tri_min_angle",
    "log_to_stderr",
];

#[cfg(unix)]
fn with_prefix(prefix: &str) -> Vec<String> {
    let own = ["use_gpu", "num_threads", "max_image_size"].map(|name| format!("{prefix}.{name}"));
    COMMON.iter().map(|name| (*name).to_owned()).chain(own).collect()
}

/// The values that the stand-in was given, by flag.
#[cfg(unix)]
fn given(folder: &Path) -> std::collections::HashMap<String, String> {
    let text = std::fs::read_to_string(folder.join("arguments")).unwrap();
    let words: Vec<&str> = text.lines().skip(1).collect();
    words.chunks_exact(2).map(|pair| (pair[0].trim_start_matches("--").to_owned(), pair[1].to_owned())).collect()
}

#[cfg(unix)]
#[test]
fn each_version_is_given_its_own_flag_names() {
    for (version, prefix, other) in [
        ("COLMAP 3.8 (Commit Unknown on Unknown without CUDA)", "SiftExtraction", "FeatureExtraction"),
        ("COLMAP 4.2.1 (Commit 0123456 on 2026-01-01 without CUDA)", "FeatureExtraction", "SiftExtraction"),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let flags = with_prefix(prefix);
        let flags: Vec<&str> = flags.iter().map(String::as_str).collect();
        let path = stand_in(folder.path(), version, &flags, 0);
        let colmap = Colmap::find(&ColmapProgram::Binary(path)).unwrap();
        assert!(version.starts_with(&colmap.version()) && colmap.version().len() > 9, "{}", colmap.version());
        let counted = std::sync::Mutex::new(Vec::new());
        let count = |done, total| counted.lock().unwrap().push((done, total));
        colmap.extract(&extraction(folder.path()), &count).unwrap();
        assert_eq!(counted.into_inner().unwrap(), [(1, 2)]);
        let arguments = given(folder.path());
        assert_eq!(arguments[&format!("{prefix}.use_gpu")], "0");
        assert_eq!(arguments[&format!("{prefix}.max_image_size")], "640");
        assert!(!arguments.contains_key(&format!("{other}.use_gpu")));
        assert!(!arguments.contains_key("refine_intrinsics"), "a flag that the program does not know");
        colmap.triangulate(&triangulation(folder.path()), &|_, _| {}).unwrap();
        let arguments = given(folder.path());
        assert_eq!(arguments["clear_points"], "1");
        assert_eq!(arguments["Mapper.ba_refine_focal_length"], "0");
    }
}

#[cfg(unix)]
#[test]
fn a_failing_step_reports_the_command_and_its_last_words() {
    let folder = tempfile::tempdir().unwrap();
    let flags = with_prefix("SiftExtraction");
    let flags: Vec<&str> = flags.iter().map(String::as_str).collect();
    let path = stand_in(folder.path(), "COLMAP 3.8 (x)", &flags, 3);
    let colmap = Colmap::find(&ColmapProgram::Binary(path)).unwrap();
    let message = colmap.extract(&extraction(folder.path()), &|_, _| {}).unwrap_err().to_string();
    for part in ["feature_extractor", "exit status: 3", "--database_path", "the last word"] {
        assert!(message.contains(part), "'{part}' in: {message}");
    }
}

#[cfg(unix)]
#[test]
fn a_program_without_a_needed_flag_is_refused_before_it_runs() {
    let folder = tempfile::tempdir().unwrap();
    let path = stand_in(folder.path(), "COLMAP 9.0 (x)", &COMMON, 0);
    let colmap = Colmap::find(&ColmapProgram::Binary(path)).unwrap();
    let message = colmap.extract(&extraction(folder.path()), &|_, _| {}).unwrap_err().to_string();
    assert!(message.contains("SiftExtraction.use_gpu"), "{message}");
    assert!(!folder.path().join("arguments").exists());
}

#[test]
fn a_missing_program_says_what_was_tried_and_what_to_install() {
    let nowhere = PathBuf::from("no/such/program");
    for program in [ColmapProgram::Binary(nowhere.clone()), ColmapProgram::Pycolmap(Some(nowhere))] {
        let message = Colmap::find(&program).unwrap_err().to_string();
        assert!(message.contains("no/such/program") && message.contains("apt install colmap"), "{message}");
    }
}

#[cfg(unix)]
#[test]
fn a_program_that_is_not_colmap_is_refused() {
    let message = Colmap::find(&ColmapProgram::Binary("echo".into())).unwrap_err().to_string();
    assert!(message.contains("does not answer as COLMAP does"), "{message}");
    let message = Colmap::find(&ColmapProgram::Pycolmap(Some("false".into()))).unwrap_err().to_string();
    assert!(message.contains("has no pycolmap"), "{message}");
}

#[test]
fn programs_are_named_as_on_the_command_line() {
    for (text, program) in [
        ("auto", ColmapProgram::Auto),
        ("pycolmap", ColmapProgram::Pycolmap(None)),
        ("pycolmap:venv/bin/python", ColmapProgram::Pycolmap(Some("venv/bin/python".into()))),
        ("/opt/colmap/bin/colmap", ColmapProgram::Binary("/opt/colmap/bin/colmap".into())),
    ] {
        assert_eq!(ColmapProgram::from(text.to_owned()), program);
        assert_eq!(String::from(program), text);
    }
}

/// A stand-in that does nothing the first `times` times that a step is run, each time after writing half a database.
#[cfg(target_os = "linux")]
fn sleeper(folder: &Path, times: u32) -> PathBuf {
    let flags = with_prefix("SiftExtraction");
    let flags: Vec<&str> = flags.iter().map(String::as_str).collect();
    let path = stand_in(folder, "COLMAP 3.8 (x)", &flags, 0);
    let script = std::fs::read_to_string(&path).unwrap();
    let folder = folder.display();
    let sleep = format!(
        "[ -e '{folder}/database.db' ] && touch '{folder}/seen'\necho half > '{folder}/database.db'\necho x >> '{folder}/begun'\n\
         if [ $(wc -l < '{folder}/begun') -le {times} ]; then echo 'Processed file [1/2]'; sleep 600; fi\nprintf"
    );
    std::fs::write(&path, script.replace("\nprintf", &format!("\n{sleep}"))).unwrap();
    path
}

#[cfg(target_os = "linux")]
#[test]
fn a_step_that_hangs_is_begun_again_from_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = sleeper(folder.path(), 1);
    let colmap = Colmap::find_within(&ColmapProgram::Binary(path), Duration::from_secs(2)).unwrap();
    let counted = std::sync::Mutex::new(0);
    colmap.extract(&extraction(folder.path()), &|_, _| *counted.lock().unwrap() += 1).unwrap();
    assert_eq!(std::fs::read_to_string(folder.path().join("begun")).unwrap().lines().count(), 2);
    assert_eq!(counted.into_inner().unwrap(), 2);
    assert!(!folder.path().join("seen").exists(), "the half database of the first attempt was there for the second");
}

#[cfg(target_os = "linux")]
#[test]
fn a_step_that_always_hangs_says_what_happened_and_what_to_try() {
    let folder = tempfile::tempdir().unwrap();
    let path = sleeper(folder.path(), 9);
    let colmap = Colmap::find_within(&ColmapProgram::Binary(path), Duration::from_secs(1)).unwrap();
    let error = colmap.extract(&extraction(folder.path()), &|_, _| {}).unwrap_err();
    assert!(matches!(error, RunError::Hung { step: "feature_extractor", attempts: 3, .. }), "{error}");
    let message = error.to_string();
    for part in ["3 times", "1 s", "--database_path", "Processed file [1/2]", "--colmap"] {
        assert!(message.contains(part), "'{part}' in: {message}");
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_program_that_never_answers_is_no_colmap() {
    let folder = tempfile::tempdir().unwrap();
    let path = stand_in(folder.path(), "COLMAP 3.8 (x)", &[], 0);
    std::fs::write(&path, "#!/bin/sh\nsleep 600\n").unwrap();
    let error = Colmap::find_within(&ColmapProgram::Binary(path), Duration::from_secs(1)).unwrap_err();
    assert!(error.to_string().contains("no answer in 1 s"), "{error}");
}
