//! Judges an initial cloud of the Panoptic basketball scene by what is known about the place.
//!
//! Usage: `cargo run -p erfgs-lab --features studies --bin cloud_quality -- DATASET PANOPTIC METHOD [OPTIONS.json [OUT.ply]]`, where DATASET
//! was imported from the folder PANOPTIC and OPTIONS.json holds any of the cloud's options.
//!
//! There is no surface ground truth. A point counts as right if it lies on the floor (within 8 cm of the plane y = 0
//! inside the dome), on the dome (within 20 cm of a sphere of 2.757 m) or inside the silhouettes of the people and the
//! ball in at least 90 % of the training cameras that see it. A wrong point can pass by chance, and a lamp
//! tube fails though right.

use std::{collections::HashMap, env, error::Error, path::Path, time::Instant};

use erfgs_dataset::{Dataset, Split};
use erfgs_points::{Cloud, CloudOptions, CloudPoint, CloudStep, initial_cloud};
use erfgs_scene::{image::ImageGrey8, ply::PointCloud};
use glam::DVec3;

const DOME_CENTRE: DVec3 = DVec3::new(0.0, -1.24, -0.04);
const DOME_RADIUS_M: f64 = 2.757;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
enum Place {
    Floor,
    Wall,
    People,
    Other,
}

struct Judge<'a> {
    dataset: &'a Dataset,
    panoptic: &'a Path,
    silhouettes: HashMap<(String, i64), Option<ImageGrey8>>,
}

impl Judge<'_> {
    fn silhouette(&mut self, camera: &str, t_ns: i64) -> Option<&ImageGrey8> {
        let frame = 40 + (t_ns as f64 * 30e-9).round() as i64;
        let number: String = camera.chars().filter(char::is_ascii_digit).collect();
        let number: u32 = number.parse().unwrap_or(0);
        let path = self.panoptic.join(format!("seg/{number}/{frame:06}.png"));
        let entry = self.silhouettes.entry((camera.to_owned(), t_ns));
        entry.or_insert_with(|| ImageGrey8::read(&path).ok()).as_ref()
    }

    fn place(&mut self, point: &CloudPoint) -> Place {
        let p = point.position;
        let from_dome = (p - DOME_CENTRE).length() - DOME_RADIUS_M;
        if p.y.abs() < 0.08 && from_dome < 0.2 {
            return Place::Floor;
        }
        let (mut views, mut inside) = (0, 0);
        let dataset = self.dataset;
        for camera in dataset.cameras(Split::Train) {
            let seen = camera.world_to_camera.transform(p);
            let pixel = camera.intrinsics.project_pinhole(seen);
            let (u, v) = (pixel.x / f64::from(camera.intrinsics.width), pixel.y / f64::from(camera.intrinsics.height));
            if seen.z <= 0.0 || !(0.0..1.0).contains(&u) || !(0.0..1.0).contains(&v) {
                continue;
            }
            if let Some(image) = self.silhouette(&camera.name, point.t_ns) {
                views += 1;
                let (x, y) = ((u * f64::from(image.width)) as usize, (v * f64::from(image.height)) as usize);
                inside += usize::from(image.data[y * image.width as usize + x] > 0);
            }
        }
        if views > 0 && inside * 10 >= views * 9 {
            Place::People
        } else if from_dome.abs() < 0.2 || (p.y.abs() < 0.3 && (0.2..0.35).contains(&from_dome)) {
            // The second: the ledge that the dome stands on.
            Place::Wall
        } else {
            Place::Other
        }
    }
}

fn report(cloud: &Cloud, judge: &mut Judge<'_>) {
    let mut places: HashMap<Place, usize> = HashMap::new();
    let mut times: HashMap<i64, (usize, usize)> = HashMap::new();
    let mut spread = [Vec::new(), Vec::new()];
    for point in &cloud.points {
        let place = judge.place(point);
        *places.entry(place).or_default() += 1;
        let time = times.entry(point.t_ns).or_default();
        time.0 += 1;
        time.1 += usize::from(place == Place::People);
        match place {
            Place::Floor => spread[0].push(point.position.y.abs()),
            Place::Wall => spread[1].push(((point.position - DOME_CENTRE).length() - DOME_RADIUS_M).abs()),
            _ => {}
        }
    }
    let n = cloud.points.len() as f64;
    let of = |place| places.get(&place).copied().unwrap_or(0);
    println!(
        "points {n} floor {} wall {} people {} other {} = {:.1} %",
        of(Place::Floor),
        of(Place::Wall),
        of(Place::People),
        of(Place::Other),
        100.0 * of(Place::Other) as f64 / n
    );
    let mean = |f: &dyn Fn(&CloudPoint) -> f64| cloud.points.iter().map(f).sum::<f64>() / n;
    println!(
        "track {:.2} error {:.2} px, static {}",
        mean(&|p| f64::from(p.track)),
        mean(&|p| f64::from(p.reprojection_error_px)),
        cloud.points.iter().filter(|p| p.instants > 1).count()
    );
    for (name, values) in ["floor", "wall"].iter().zip(&mut spread) {
        values.sort_by(f64::total_cmp);
        if let Some(median) = values.get(values.len() / 2) {
            println!("median distance from the {name}: {:.1} mm", 1e3 * median);
        }
    }
    let mut times: Vec<_> = times.into_iter().collect();
    times.sort();
    for (t_ns, (all, people)) in times {
        println!("t {:.4} s: {all} points first seen, {people} on people and ball", t_ns as f64 * 1e-9);
    }
    for (name, value) in cloud.parameters.iter().filter(|(_, value)| value.is_number() || value.is_string()) {
        println!("{name} {value}");
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let [dataset, panoptic, method, rest @ ..] = arguments.as_slice() else {
        return Err("usage: cloud_quality DATASET PANOPTIC METHOD [OPTIONS.json [OUT.ply]]".into());
    };
    let dataset = Dataset::load(Path::new(dataset))?;
    let mut options: CloudOptions = match rest.first() {
        Some(text) => serde_json::from_str(text)?,
        None => CloudOptions { max_points: None, ..CloudOptions::default() },
    };
    options.method = method.parse()?;
    let start = Instant::now();
    let last = std::sync::Mutex::new((CloudStep::Images, Instant::now()));
    let work = tempfile::tempdir()?;
    let cloud = initial_cloud(&dataset, &options, work.path(), &|stage, _, _| {
        let mut last = last.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        if last.0 != stage {
            println!("{} {:.1} s", last.0, last.1.elapsed().as_secs_f64());
            *last = (stage, Instant::now());
        }
    })?;
    println!("all {:.1} s", start.elapsed().as_secs_f64());
    if let Some(path) = rest.get(1) {
        let positions = cloud.points.iter().map(|point| point.position.as_vec3().to_array()).collect();
        let colours = cloud.points.iter().map(|point| point.colour).collect();
        PointCloud { positions, colours }.write(Path::new(path))?;
    }
    report(&cloud, &mut Judge { dataset: &dataset, panoptic: Path::new(panoptic), silhouettes: HashMap::new() });
    Ok(())
}
