//! What is said and left where a file cannot be written to its end, of every command that writes one.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    process::Command,
};

use crate::recording::{dataset::FILM, files::write_session, merge::write_hosts};

/// Every file and folder below `folder`, with the lengths of files.
fn below(folder: &Path) -> BTreeMap<PathBuf, u64> {
    let mut found = BTreeMap::new();
    for entry in fs::read_dir(folder).expect("a folder").flatten() {
        let path = entry.path();
        let about = fs::metadata(&path).expect("told");
        if about.is_dir() {
            found.extend(below(&path));
        }
        found.insert(path, if about.is_dir() { 0 } else { about.len() });
    }
    found
}

/// Runs a command whose files may have so many blocks of 512 bytes, and says how it ended and what it said.
fn within(folder: &Path, blocks: u32, words: &str) -> (Option<i32>, String) {
    let script = format!("trap '' XFSZ; ulimit -f {blocks}; exec \"$0\" \"$@\"");
    let mut command = Command::new("sh");
    command.args(["-c", &script, env!("CARGO_BIN_EXE_erfgs")]).args(words.split(' ')).current_dir(folder);
    let output = command.output().expect("sh runs");
    (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
}

#[test]
fn what_does_not_fit_is_named_by_its_place_with_what_helps_and_leaves_nothing() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    write_session(folder);
    write_hosts(folder);
    for name in ["take.mcap", "rig.json", "film"] {
        std::os::unix::fs::symlink(FILM.path().join(name), folder.join(name)).expect("linked");
    }
    let whole = fs::read(folder.join("s.mcap")).expect("read");
    fs::write(folder.join("cut.mcap"), &whole[..whole.len() - 20_000]).expect("written");
    let before = below(folder);
    let mut commands = vec![
        ("export s.mcap --to raw --stream ev0 --out out.raw", 16, "out.raw"),
        ("export s.mcap --to csv --stream ev0 --out out.csv", 16, "out.csv"),
        ("export s.mcap --to npz --stream ev0 --out out.npz", 16, "out.npz"),
        ("export s.mcap --to dat --stream ev0 --out out.dat", 16, "out.dat"),
        ("export s.mcap --to aedat4 --stream ev0 --out out.aedat4", 16, "out.aedat4"),
        ("export s.mcap --to png --stream cam0 --out out", 1, "out/"),
        ("export s.mcap --to exr --stream cam0 --out out", 1, "out/"),
        ("export s.mcap --to mp4 --stream cam0 --out out.mp4", 1, "out.mp4"),
        ("export s.mcap --to session --from 0.1 --out out.mcap", 16, "out.mcap"),
        ("export s.mcap --to foxglove --out out.mcap", 16, "out.mcap"),
        ("export s.mcap --to rosbag2 --out out", 16, "out/out_0.mcap"),
        ("export film --to colmap --out out", 1, "out/images"),
        ("export film --to nerfstudio --out out", 1, "out/images"),
        ("recover cut.mcap --out out.mcap", 16, "out.mcap"),
        ("recover cut.mcap --in-place", 1, "cut.mcap"),
        ("merge left.mcap right.mcap --out out.mcap", 16, "out.mcap"),
        ("sync s.mcap --out out.json", 1, "out.json"),
        ("dataset undistort film --out out", 1, "out/images"),
        ("dataset variant film --subsample 2 --blur 2 --out out", 1, "out/images"),
        ("dataset import session take.mcap --rig rig.json --out out", 1, "out/"),
        // The points have room, and the manifest that would name them has none.
        ("dataset points film --method random --random-points 10 --moving 0 --trust-poses", 1, "film/dataset.json"),
        ("calibrate convert rig.json --to kalibr --out out", 1, "out"),
        ("calibrate convert rig.json --to nerfstudio --out out", 1, "out"),
    ];
    #[cfg(feature = "hdf5")]
    commands.push(("export s.mcap --to h5 --stream ev0 --out out.h5", 16, "out.h5"));
    for (words, blocks, place) in commands {
        let (code, output) = within(folder, blocks, words);
        assert_eq!(code, Some(1), "erfgs {words}\n{output}");
        assert!(output.contains(place), "erfgs {words}\n{output}");
        assert!(!output.contains(".writing-") && !output.contains("panicked"), "erfgs {words}\n{output}");
        assert!(output.contains("choose another disk") || output.contains("another place"), "erfgs {words}\n{output}");
        let after = below(folder);
        assert!(after == before, "erfgs {words}\n{output}\n{after:?}");
    }
}
