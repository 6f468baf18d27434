//! Every target over its seeds and so many mutations of them, the same each time.
//!
//! What fails is written to `target/fuzz/artifacts`. To run one target: `cargo test -p erfgs-fuzz evt3`.

use std::{
    fs,
    panic::{AssertUnwindSafe, catch_unwind},
    path::{Path, PathBuf},
};

use erfgs_base::random;
use erfgs_fuzz::{TARGETS, mutation, seeds, target};

/// Where inputs go that fail.
fn artifacts() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../target/fuzz/artifacts")
}

/// The inputs of a target: its seeds, then mutation after mutation of them, with names.
fn inputs(name: &str, mutations: u64) -> impl Iterator<Item = (String, Vec<u8>)> {
    let all = seeds(name);
    let purpose = random::purpose(name);
    let plain = all.iter().enumerate().map(|(index, seed)| (format!("seed-{index}"), seed.clone()));
    let changed = (0..mutations)
        .map(move |number| (format!("mutation-{number}"), mutation(all, random::key(number, &[purpose]))));
    plain.chain(changed)
}

/// Gives `target` its inputs. One that makes it panic is written to `artifacts`, and what follows says which it is.
fn check(name: &str, target: impl Fn(&[u8]), mutations: u64, artifacts: &Path) {
    assert!(!seeds(name).is_empty(), "{name} has no seeds");
    for (input, bytes) in inputs(name, mutations) {
        let Err(cause) = catch_unwind(AssertUnwindSafe(|| target(&bytes))) else { continue };
        let path = artifacts.join(format!("{name}-{input}"));
        fs::create_dir_all(artifacts).and_then(|()| fs::write(&path, &bytes)).unwrap();
        let text = cause.downcast_ref::<&str>().copied();
        let message = cause.downcast_ref::<String>().map(String::as_str).or(text).unwrap_or("it panicked");
        panic!("{name} fails for {input}, which is {}: {message}", path.display());
    }
}

/// A test for each target, with the number of mutations: together they take some 15 seconds of one core.
/// `scripts/fuzz.sh` looks for longer.
macro_rules! targets {
    ($($(#[$only:meta])? $name:ident $mutations:literal,)*) => {
        $($(#[$only])?
        #[test]
        fn $name() {
            let name = stringify!($name);
            check(name, target(name).unwrap(), $mutations, &artifacts());
        })*

        #[test]
        fn every_target_is_tested() {
            assert_eq!(TARGETS.iter().map(|&(name, _)| name).collect::<Vec<_>>(), [$($(#[$only])? stringify!($name)),*]);
        }
    };
}

targets! {
    evt2 40_000,
    evt21 40_000,
    evt3 40_000,
    dat 40_000,
    aedat2 40_000,
    aedat4 20_000,
    davis 40_000,
    csv 40_000,
    es 40_000,
    headers 40_000,
    npy 40_000,
    npz 20_000,
    container 8_000,
    repair 5_000,
    ecf 40_000,
    blosc 40_000,
    frames 40_000,
    #[cfg(target_os = "linux")]
    gencp 40_000,
    #[cfg(target_os = "linux")]
    u3vstream 40_000,
    #[cfg(target_os = "linux")]
    u3vcamera 20_000,
}

#[test]
fn an_input_that_fails_is_kept_and_named() {
    let folder = tempfile::tempdir().unwrap();
    let seeds = seeds("evt2");
    let fails = |bytes: &[u8]| assert!(seeds.iter().any(|seed| seed == bytes), "no seed");
    let message = catch_unwind(|| check("evt2", fails, 1000, folder.path())).unwrap_err();
    let message = message.downcast_ref::<String>().unwrap();
    let files: Vec<_> = fs::read_dir(folder.path()).unwrap().map(|file| file.unwrap().path()).collect();
    let [path] = &files[..] else { panic!("{files:?}") };
    assert!(message.contains(path.to_str().unwrap()) && message.ends_with(": no seed"), "{message}");
    let number = path.file_name().unwrap().to_str().unwrap().strip_prefix("evt2-mutation-").unwrap();
    let again = mutation(seeds, random::key(number.parse().unwrap(), &[random::purpose("evt2")]));
    assert_eq!(fs::read(path).unwrap(), again);
}
