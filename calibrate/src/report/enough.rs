//! Whether a calibration is good enough: how far its uncertainty moves what each camera sees, against what that costs a
//! reconstruction.

use erfgs_page::html::{self, Escaped, number};
use erfgs_scene::rig_file::{RigCamera, RigFile};
use glam::DVec3;

use crate::geometry::{Ray, nearest_point};

/// What an error of the cameras costs.
struct Cost {
    /// How far it moves what they see, root mean square, pixels of the pictures that are trained with.
    moved_px: f64,
    /// What is lost, dB of PSNR.
    lost_db: f64,
    /// Where it is lost.
    place: &'static str,
}

const MOVING: &str = "where things move";
const STILL: &str = "where nothing moves";

/// The mean (geometric) of places, directions and focal lengths in `docs/results/budget.md`.
const COSTS: [Cost; 3] = [
    Cost { moved_px: 0.61, lost_db: 0.5, place: STILL },
    Cost { moved_px: 1.23, lost_db: 0.5, place: MOVING },
    Cost { moved_px: 1.93, lost_db: 1.0, place: MOVING },
];

/// What a camera's uncertainty comes to at the middle of the scene, pixels of its full pictures; `None` where it is not known.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Moved {
    place: Option<f64>,
    direction: Option<f64>,
    focal: Option<f64>,
}

impl Moved {
    fn of(camera: &RigCamera, middle: Option<DVec3>) -> Option<Self> {
        let (pose, sigma) = (camera.pose?, camera.sigma.as_ref()?);
        let intrinsics = &camera.intrinsics;
        let across = |sigmas: &[Option<f64>; 3]| {
            let squares: Option<f64> = sigmas.iter().map(|sigma| sigma.map(|sigma| sigma * sigma)).sum();
            // Two of the three directions move what is seen, as far as it matters.
            squares.map(|squares| (squares * 2.0 / 3.0).sqrt())
        };
        let depth = middle.map(|middle| pose.transform(middle).z).filter(|depth| *depth > 0.0);
        let focal = match sigma.intrinsics.get("fx") {
            None => Some(0.0),
            Some(sigma) => sigma.map(|sigma| {
                let [width, height] = [intrinsics.width, intrinsics.height].map(f64::from);
                // The root mean square distance of a pixel from the middle.
                sigma / intrinsics.fx * ((width * width + height * height) / 12.0).sqrt()
            }),
        };
        Some(Self {
            place: across(&sigma.centre_m).zip(depth).map(|(metres, depth)| metres * intrinsics.fx / depth),
            direction: across(&sigma.rotation_deg).map(|degrees| degrees.to_radians() * intrinsics.fx),
            focal,
        })
    }

    fn together(self) -> Option<f64> {
        Some((self.place?.powi(2) + self.direction?.powi(2) + self.focal?.powi(2)).sqrt())
    }
}

/// The table, or nothing where no uncertainty is known.
pub(super) fn table(rig: &RigFile) -> String {
    let rays: Vec<Ray> = rig
        .cameras
        .iter()
        .filter_map(|camera| camera.pose)
        .map(|pose| Ray { origin: pose.centre(), direction: pose.rotation.conjugate() * DVec3::Z })
        .collect();
    let middle = nearest_point(&rays);
    let known: Vec<(&RigCamera, Moved)> =
        rig.cameras.iter().filter_map(|camera| Some((camera, Moved::of(camera, middle)?))).collect();
    if known.is_empty() {
        return String::new();
    }
    let limits = COSTS
        .map(|cost| format!("<th>{} dB <small>{}, px wide</small></th>", number(cost.lost_db, 2), cost.place))
        .concat();
    let head = format!(
        "<tr><th>Camera</th><th>Place <small>px</small></th><th>Direction <small>px</small></th><th>Focal length \
         <small>px</small></th><th>Together <small>px</small></th>{limits}</tr>"
    );
    let rows: String = known.iter().map(|(camera, moved)| row(camera, *moved)).collect();
    html::table("figures", &head, &rows)
        + "<p class=\"caption\">Image shift, in the middle of the scene and in full pictures, by one standard deviation of each \
        quantity; and the largest width of training pictures at which the error costs no more than the stated loss. The losses were \
        measured with known errors (<code>erfgs bench budget</code>, docs/results/budget.md).</p>\n"
}

fn row(camera: &RigCamera, moved: Moved) -> String {
    let pixels = |value: Option<f64>| value.map_or("–".into(), |value| number(value, 3));
    let together = moved.together();
    let widest = COSTS.map(|cost| {
        let width = f64::from(camera.intrinsics.width);
        let text = together.map_or("–".into(), |px| match cost.moved_px / px {
            scale if scale >= 1.0 => format!("{} (all)", camera.intrinsics.width),
            scale => number((width * scale).floor(), 0),
        });
        format!("<td>{text}</td>")
    });
    format!(
        "<tr><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td>{}</tr>\n",
        Escaped(&camera.name),
        pixels(moved.place),
        pixels(moved.direction),
        pixels(moved.focal),
        pixels(together),
        widest.concat()
    )
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use erfgs_scene::{Distortion, Intrinsics, Modality, Pose, rig_file::Sigma};

    use super::*;

    /// Two cameras that look at the origin from two metres, of which the second is known to 2 mm, 0.1 degrees and half a percent.
    fn rig() -> RigFile {
        let intrinsics = Intrinsics {
            width: 640,
            height: 480,
            fx: 500.0,
            fy: 500.0,
            cx: 320.0,
            cy: 240.0,
            distortion: Distortion::None,
        };
        let camera = |name: &str, eye: DVec3| {
            let pose = Pose::look_at(eye, DVec3::ZERO, DVec3::Y);
            RigCamera::new(name, Modality::Rgb, intrinsics, Some(pose))
        };
        let mut cameras = vec![camera("a", DVec3::NEG_Z * 2.0), camera("<b>", DVec3::X * 2.0)];
        let none = [Some(0.0); 3];
        cameras[0].sigma = Some(Sigma { centre_m: none, rotation_deg: none, ..Sigma::default() });
        cameras[1].sigma = Some(Sigma {
            centre_m: [Some(0.002); 3],
            rotation_deg: [Some(0.1); 3],
            intrinsics: BTreeMap::from([("fx".to_owned(), Some(2.5))]),
            ..Sigma::default()
        });
        RigFile::new("board", true, cameras)
    }

    #[test]
    fn uncertainty_is_told_in_pixels_of_the_middle_of_the_scene() {
        let moved = Moved::of(&rig().cameras[1], Some(DVec3::ZERO)).unwrap();
        let close =
            |found: Option<f64>, expected: f64| assert!((found.unwrap() / expected - 1.0).abs() < 1e-9, "{moved:?}");
        let two_axes = 2.0_f64.sqrt();
        close(moved.place, two_axes * 0.002 * 500.0 / 2.0);
        close(moved.direction, two_axes * 0.1_f64.to_radians() * 500.0);
        close(moved.focal, 0.005 * (800.0_f64 * 800.0 / 12.0).sqrt());
        let page = table(&rig());
        assert!(page.contains("&lt;b&gt;") && page.contains("640 (all)"), "{page}");
        let widest = (640.0 * COSTS[0].moved_px / moved.together().unwrap()).floor();
        assert!(page.contains(&format!("<td>{}</td>", number(widest, 0))), "{page}");
    }

    #[test]
    fn what_is_not_known_is_not_judged() {
        let mut rig = rig();
        rig.cameras[1].sigma.as_mut().unwrap().centre_m[0] = None;
        let moved = Moved::of(&rig.cameras[1], Some(DVec3::ZERO)).unwrap();
        assert_eq!((moved.place, moved.together()), (None, None));
        rig.cameras.iter_mut().for_each(|camera| camera.sigma = None);
        assert_eq!(table(&rig), "");
    }

    /// The costs are those that were measured: between two steps by a straight line over the logarithm of the pixels.
    #[test]
    fn costs_are_those_of_the_error_budget() {
        let lines: Vec<Vec<&str>> =
            include_str!("../../../docs/results/budget.csv").lines().map(|line| line.split(',').collect()).collect();
        let number = |text: &str| text.parse::<f64>().unwrap();
        let usual: Vec<f64> =
            lines.iter().filter(|cells| cells[0] == "nothing").map(|cells| number(cells[7])).collect();
        let usual = usual.iter().sum::<f64>() / usual.len() as f64;
        for Cost { moved_px, lost_db, place } in COSTS {
            let mut product = 1.0;
            for cause in ["place", "direction", "focal length"] {
                let lost = |cells: &[&str]| if place == STILL { usual - number(cells[7]) } else { number(cells[8]) };
                let mut steps: Vec<(f64, f64)> = Vec::new();
                // The runs of a step lie one behind the other.
                let of_cause: Vec<_> = lines.iter().filter(|cells| cells[0] == cause).collect();
                for runs in of_cause.chunk_by(|one, next| one[2] == next[2]) {
                    let lost = runs.iter().map(|cells| lost(cells)).sum::<f64>() / runs.len() as f64;
                    steps.push((number(runs[0][3]), lost));
                }
                let dear = steps.iter().position(|(_, lost)| *lost > lost_db).unwrap();
                let ((from_px, from), (to_px, to)) = (steps[dear - 1], steps[dear]);
                product *= from_px * (to_px / from_px).powf((lost_db - from) / (to - from));
            }
            let measured = f64::cbrt(product);
            assert!(
                (moved_px / measured - 1.0).abs() < 0.1,
                "{lost_db} dB {place}: {moved_px} px, measured {measured}"
            );
        }
    }
}
