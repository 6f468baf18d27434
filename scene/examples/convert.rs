//! Reads the calibration of another program, whatever its format, and writes it as `rig.json`.
//!
//! usage: convert CALIBRATION RIG.json

use std::{env, error::Error, path::Path};

use erfgs_scene::exchange::{self, Format};

fn main() -> Result<(), Box<dyn Error>> {
    let mut words = env::args().skip(1);
    let (Some(from), Some(to)) = (words.next(), words.next()) else {
        return Err("usage: convert CALIBRATION RIG.json".into());
    };
    let rig = exchange::read(Path::new(&from))?;
    for camera in &rig.cameras {
        let lens = &camera.intrinsics;
        println!("{}: {} x {}, fx {:.1} px", camera.name, lens.width, lens.height, lens.fx);
    }
    for warning in &rig.warnings {
        println!("{warning}");
    }
    // What the format cannot store comes back as sentences; rig.json stores everything.
    let lost = exchange::write(&rig, Format::Rig, Path::new(&to))?;
    assert!(lost.is_empty());
    Ok(())
}
