//! Points of what moves: the visual hull of the moving pixels.
//!
//! What flies through a room has few features, and those are blurred. But in every view it differs from what the view shows
//! most of the time. A cell of space is part of what moves if all the views that see it, but for one in eight, see moving
//! pixels there; space is halved until a cell is about two pixels wide.

mod silhouette;

use std::collections::{HashMap, HashSet};

use glam::{DVec3, IVec3};
use rayon::prelude::*;

use self::silhouette::Silhouette;
use super::{
    CloudError, CloudOptions, CloudPoint, CloudStep, Counts, HullOptions, Progress,
    photo::{Photo, median_colour},
    rig::{Reach, Rig, Station, all_instants, spread},
};

/// Frames of a camera that its usual look is taken from, at most; with fewer than the least there is no usual look.
const USUAL_OF: usize = 15;
const FEWEST_FRAMES: usize = 4;
/// Cells along the longest side of space before it is halved.
const COARSEST: i32 = 16;
/// Space is halved at most so many times.
const MOST_HALVINGS: u32 = 7;
/// More cells than this are no small moving thing: the lights changed, or the cameras shook.
const MOST_CELLS: usize = 400_000;

/// A view of one instant.
struct SilhouetteView<'a> {
    station: &'a Station<'a>,
    photo: Photo,
    silhouette: Silhouette,
}

/// Cubes of space.
struct Grid {
    origin: DVec3,
    side_m: f64,
}

impl Grid {
    fn centre(&self, cell: IVec3) -> DVec3 {
        self.origin + (cell.as_dvec3() + 0.5) * self.side_m
    }
}

/// The points on the hull of what moves, at the instants that the options ask for.
pub fn points(
    rig: &Rig<'_>,
    options: &CloudOptions,
    reach: &Reach,
    progress: Progress<'_>,
    counts: &mut Counts,
) -> Result<Vec<CloudPoint>, CloudError> {
    let hull = &options.hull;
    if rig.stations.iter().any(|station| station.camera.frames.len() < FEWEST_FRAMES) {
        counts.insert("moving_points".into(), 0.into());
        return Ok(Vec::new());
    }
    let all = all_instants(&rig.stations);
    let chosen = spread(all.len(), hull.instants as usize);
    progress(CloudStep::Silhouettes, 0, chosen.len() + 1);
    let usual: Vec<Vec<[u8; 3]>> =
        (0..rig.stations.len()).into_par_iter().map(|station| usual(rig, station)).collect::<Result<_, _>>()?;
    let mut points = Vec::new();
    for (done, &index) in chosen.iter().enumerate() {
        progress(CloudStep::Silhouettes, done + 1, chosen.len() + 1);
        let instant = &all[index];
        let views: Vec<SilhouetteView<'_>> = instant
            .shots
            .par_iter()
            .map(|&(station, frame)| {
                let photo = rig.photo(station, frame)?;
                let silhouette = Silhouette::new(photo.image(), &usual[station], hull.threshold);
                Ok(SilhouetteView { station: &rig.stations[station], photo, silhouette })
            })
            .collect::<Result<_, CloudError>>()?;
        let (grid, cells) = carve(&views, reach, hull);
        let most = (hull.max_points as usize / chosen.len()).max(1);
        points.extend(surface(&grid, &cells, &views, instant.t_ns, most));
    }
    progress(CloudStep::Silhouettes, chosen.len() + 1, chosen.len() + 1);
    counts.insert("moving_points".into(), points.len().into());
    Ok(points)
}

/// What a camera shows most of the time: the median of its frames, row-major.
pub fn usual(rig: &Rig<'_>, station: usize) -> Result<Vec<[u8; 3]>, CloudError> {
    let frames = &rig.stations[station].camera.frames;
    let photos: Vec<Photo> = spread(frames.len(), USUAL_OF)
        .into_iter()
        .map(|frame| rig.photo(station, &frames[frame]))
        .collect::<Result<_, _>>()?;
    let k = rig.stations[station].intrinsics();
    let pixel = |at: u32| {
        let colours: Vec<[u8; 3]> =
            photos.iter().map(|photo| photo.image().pixel(at % k.width, at / k.width)).collect();
        median_colour(&colours)
    };
    Ok((0..k.width * k.height).map(pixel).collect())
}

/// The finest cells that are part of what moves.
fn carve(views: &[SilhouetteView<'_>], reach: &Reach, hull: &HullOptions) -> (Grid, Vec<IVec3>) {
    // What the cameras look at, and as much around it as lies between them.
    let count = views.len().max(1) as f64;
    let target: DVec3 =
        views.iter().map(|view| view.station.centre + view.station.forward() * reach.focus_m).sum::<DVec3>() / count;
    let half_m = reach.focus_m.min(reach.depth_m[1]);
    let mut grid = Grid { origin: target - half_m, side_m: 2.0 * half_m / f64::from(COARSEST) };
    let finest_m = hull.cell_px * reach.focus_m / mean_focal_px(views);
    let mut cells: Vec<IVec3> =
        (0..COARSEST.pow(3)).map(|n| IVec3::new(n, n / COARSEST, n / COARSEST / COARSEST) % COARSEST).collect();
    for _ in 0..MOST_HALVINGS {
        cells = cells.into_par_iter().filter(|&cell| may_move(&grid, cell, views, hull)).collect();
        if grid.side_m <= finest_m || cells.len() > MOST_CELLS {
            break;
        }
        grid.side_m /= 2.0;
        let halves = |cell: IVec3| (0..8).map(move |n| 2 * cell + IVec3::new(n & 1, n >> 1 & 1, n >> 2));
        cells = cells.into_iter().flat_map(halves).collect();
    }
    if cells.len() > MOST_CELLS {
        cells.clear();
    }
    (grid, cells)
}

fn mean_focal_px(views: &[SilhouetteView<'_>]) -> f64 {
    views.iter().map(|view| view.station.intrinsics().fx).sum::<f64>() / views.len().max(1) as f64
}

/// Whether enough views have moving pixels where they see a cell.
fn may_move(grid: &Grid, cell: IVec3, views: &[SilhouetteView<'_>], hull: &HullOptions) -> bool {
    let centre = grid.centre(cell);
    let (mut seeing, mut moving) = (0_u32, 0_u32);
    for view in views {
        let Some((pixel, depth_m)) = view.station.see(centre) else { continue };
        // The sphere around the cell: nothing that may move is lost where cells are large.
        let radius_px = 0.87 * grid.side_m * view.station.intrinsics().fx / depth_m.max(grid.side_m);
        seeing += 1;
        moving += u32::from(view.silhouette.any(pixel, radius_px.min(1e4)));
    }
    seeing >= hull.min_views && moving + seeing / 8 >= seeing
}

/// Cells with a neighbour that does not move, with the colour that the views show which see them first; at most `most`,
/// evenly taken.
fn surface(grid: &Grid, cells: &[IVec3], views: &[SilhouetteView<'_>], t_ns: i64, most: usize) -> Vec<CloudPoint> {
    let inside: HashSet<IVec3> = cells.iter().copied().collect();
    let sides = [IVec3::X, IVec3::NEG_X, IVec3::Y, IVec3::NEG_Y, IVec3::Z, IVec3::NEG_Z];
    let outer: Vec<IVec3> =
        cells.iter().copied().filter(|cell| sides.iter().any(|side| !inside.contains(&(*cell + *side)))).collect();
    let nearest: Vec<HashMap<[i32; 2], f64>> = views.par_iter().map(|view| depths(grid, &outer, view)).collect();
    let step = outer.len().div_ceil(most).max(1);
    let point = |&cell: &IVec3| {
        let position = grid.centre(cell);
        let colours: Vec<[u8; 3]> = std::iter::zip(views, &nearest)
            .filter_map(|(view, nearest)| {
                let (pixel, depth_m) = view.station.see(position)?;
                let first = nearest.get(&pixel.floor().as_ivec2().to_array())?;
                (depth_m <= first + 2.0 * grid.side_m).then(|| view.photo.colour(pixel))
            })
            .collect();
        (!colours.is_empty()).then(|| CloudPoint {
            position,
            colour: median_colour(&colours),
            track: colours.len() as u32,
            reprojection_error_px: 0.0,
            t_ns,
            instants: 1,
            moving: true,
        })
    };
    outer.iter().step_by(step).filter_map(point).collect()
}

/// The depth of the first cell on each pixel, metres.
fn depths(grid: &Grid, cells: &[IVec3], view: &SilhouetteView<'_>) -> HashMap<[i32; 2], f64> {
    let mut nearest = HashMap::new();
    for &cell in cells {
        if let Some((pixel, depth_m)) = view.station.see(grid.centre(cell)) {
            let first = nearest.entry(pixel.floor().as_ivec2().to_array()).or_insert(depth_m);
            *first = depth_m.min(*first);
        }
    }
    nearest
}
