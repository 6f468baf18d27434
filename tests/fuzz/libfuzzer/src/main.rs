//! Gives what libFuzzer makes up to the target that the environment variable `ERFGS_FUZZ_TARGET` names. Where
//! `ERFGS_FUZZ_SEEDS` names a folder, the target's seeds are written there before libFuzzer looks into it.

#![no_main]

use std::{env, fs, path::PathBuf, sync::LazyLock};

use erfgs_fuzz::{TARGETS, Target, seeds, target};
use libfuzzer_sys::fuzz_target;

static TARGET: LazyLock<(String, Target)> = LazyLock::new(|| {
    let name = env::var("ERFGS_FUZZ_TARGET").unwrap_or_default();
    let Some(target) = target(&name) else {
        let names: Vec<&str> = TARGETS.iter().map(|&(name, _)| name).collect();
        panic!("ERFGS_FUZZ_TARGET='{name}' is none of {}", names.join(", "));
    };
    (name, target)
});

fn write_seeds() {
    let (name, _) = &*TARGET;
    let Some(folder) = env::var_os("ERFGS_FUZZ_SEEDS").map(PathBuf::from) else { return };
    fs::create_dir_all(&folder).expect("a folder for seeds");
    for (index, seed) in seeds(name).iter().enumerate() {
        fs::write(folder.join(format!("seed-{index:03}")), seed).expect("a seed written");
    }
}

fuzz_target!(init: write_seeds(), |input: &[u8]| {
    let (_, target) = &*TARGET;
    target(input);
});
