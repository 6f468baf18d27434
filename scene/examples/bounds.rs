//! Prints the size and the middle of a point cloud (PLY), such as the initial points of a dataset.
//!
//! usage: bounds POINTS.ply

use std::{env, error::Error, path::Path};

use erfgs_scene::PointCloud;
use glam::DVec3;

fn main() -> Result<(), Box<dyn Error>> {
    let path = env::args().nth(1).ok_or("usage: bounds POINTS.ply")?;
    let cloud = PointCloud::read(Path::new(&path))?;
    let places = || cloud.positions.iter().map(|place| DVec3::from(place.map(f64::from)));
    let Some(first) = places().next() else { return Err("the cloud has no points".into()) };
    let [least, most] = places().fold([first; 2], |[least, most], place| [least.min(place), most.max(place)]);
    println!("{} points within {:.3} of {:.3}", cloud.len(), most - least, (least + most) / 2.0);
    Ok(())
}
