//! A session without hardware: what a triggered rig of RGB and event cameras records of the stage, and the rig file that a
//! perfect calibration would give.
//!
//! ```text
//! cargo run --release --example film_session -- take.mcap rig.json
//! erfgs sync take.mcap
//! erfgs dataset import session take.mcap --rig rig.json --out ds
//! ```

mod record;

use std::{error::Error, path::Path};

use erfgs_stage::{FilmOptions, film};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [session, rig] = arguments.as_slice() else { return Err("usage: film_session TAKE.mcap RIG.json".into()) };
    let folder = tempfile::tempdir()?;
    eprintln!("filming the stage");
    let options = FilmOptions { rgb_fps: 20.0, test_fps: 20.0, truth_points: 0, ..FilmOptions::default() };
    let film = film(&folder.path().join("film"), &options, &|_| {})?;
    record::write(&film.dataset, Path::new(session))?;
    record::rig(&film.dataset).write(Path::new(rig))?;
    println!("{session}: {} frames, {} events; {rig}", film.rgb_frames + film.test_frames, film.events);
    Ok(())
}
