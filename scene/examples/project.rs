//! Projects a point of the world into every camera of a rig file, through its lens.
//!
//! usage: project RIG.json X Y Z

use std::{env, error::Error, path::Path};

use erfgs_scene::rig_file::RigFile;
use glam::DVec3;

fn main() -> Result<(), Box<dyn Error>> {
    let words: Vec<String> = env::args().skip(1).collect();
    let [path, place @ ..] = &words[..] else { return Err("usage: project RIG.json X Y Z".into()) };
    let place: Vec<f64> = place.iter().map(|word| word.parse()).collect::<Result<_, _>>()?;
    let &[x, y, z] = &place[..] else { return Err("the point needs three coordinates, metres".into()) };

    let rig = RigFile::read(Path::new(path))?;
    for camera in &rig.cameras {
        let Some(pose) = camera.pose else {
            println!("{}: no pose", camera.name);
            continue;
        };
        match camera.intrinsics.project(pose.transform(DVec3::new(x, y, z))) {
            Some(pixel) => println!("{}: ({:.2}, {:.2})", camera.name, pixel.x, pixel.y),
            None => println!("{}: not in front of the camera", camera.name),
        }
    }
    Ok(())
}
