//! Where the back of a board is: as it is stated, and as people are told.
//!
//! On the sheet of the front x is to the right, y down and z into it. The back of a plate whose sides are parallel, with middles
//! and edges one behind the other, looks as if the plate had been turned about its vertical axis and is as far behind the front
//! as the plate is thick. What is found is told as what differs from that.

use std::{collections::BTreeMap, f64::consts::PI};

use erfgs_scene::Pose;
use glam::{DQuat, DVec3};

use super::{Plate, Target};
use crate::{
    bundle::{Side, SideUncertainty},
    evidence::Table,
};

/// A middle less certain than this share of the front's diagonal, or a turn less certain than so many radians, is none.
const VAGUE: f64 = 0.05;
/// And beyond this it is doubtful.
const DOUBTFUL: f64 = 0.01;

/// Takes the frame of the back's target to that of the front's on a plate of this thickness, metres, whose sides are parallel
/// and have their middles and edges one behind the other.
pub(super) fn stated(front: &Target, back: &Target, thickness_m: f64) -> Pose {
    let from_sheet = front.to_sheet().conjugate();
    let rotation = (from_sheet * turned_over() * back.to_sheet()).normalize();
    let behind = from_sheet * DVec3::Z * thickness_m;
    Pose { rotation, translation: front.middle() + behind - rotation * back.middle() }
}

/// About the vertical axis.
fn turned_over() -> DQuat {
    DQuat::from_rotation_y(PI)
}

/// The side of the adjustment that the back is.
pub(super) fn side(back: &Target, pose: Pose, free: bool) -> Side {
    Side { name: "the board's back".into(), pose, middle: back.middle(), free }
}

/// Where a back is and how well that is known: along the front's sheet to the right, down and into it.
pub(super) struct BackPose {
    /// The back's middle from the front's, metres.
    middle: DVec3,
    /// What remains of the turn about the right and about the down axis: the wedge between the sides; radians.
    tilt: [f64; 2],
    /// The turn in the plane, clockwise as seen from the front, radians.
    turn: f64,
    /// Standard deviations of the middle, metres, and of turns about the three axes, radians.
    sigma: [DVec3; 2],
    /// Diagonal of the front, metres.
    diagonal_m: f64,
}

impl BackPose {
    pub fn of(plate: &Plate, side: &Side, known: &SideUncertainty) -> Option<Self> {
        let (front, back) = (plate.front(), plate.back()?);
        let to_sheet = front.to_sheet();
        let middle = to_sheet * (side.pose.transform(side.middle) - front.middle());
        let left = to_sheet * side.pose.rotation * back.to_sheet().conjugate() * turned_over().conjugate();
        let turn = 2.0 * left.z.atan2(left.w);
        let turn = turn - (turn / (2.0 * PI)).round() * 2.0 * PI;
        let swing = left * DQuat::from_rotation_z(turn).conjugate();
        let swing = if swing.w < 0.0 { -swing } else { swing }.to_scaled_axis();
        // Axes of the target and of the sheet differ by their signs alone.
        let sigma = [known.middle, known.rotation];
        Some(Self { middle, tilt: [swing.x, swing.y], turn, sigma, diagonal_m: 2.0 * front.middle().length() })
    }

    /// How uncertain it is, against what is no longer a result.
    pub fn vagueness(&self) -> f64 {
        let [middle, turn] = self.sigma.map(DVec3::max_element);
        (middle / self.diagonal_m).max(turn) / VAGUE
    }

    /// How uncertain it is, in words.
    pub fn uncertainty(&self) -> String {
        let [middle, turn] = self.sigma.map(DVec3::max_element);
        if middle.is_finite() && turn.is_finite() {
            format!("to {:.1} mm and {:.1} degrees", 1e3 * middle, turn.to_degrees())
        } else {
            "not at all".into()
        }
    }

    /// What is doubtful about it.
    pub fn warning(&self) -> Option<String> {
        (self.vagueness() * VAGUE > DOUBTFUL).then(|| {
            format!(
                "the position of the back of the board is known only {}, which limits the poses of cameras on one side relative to \
                 the other; rotate the board about both its axes where cameras see both sides at once",
                self.uncertainty()
            )
        })
    }

    /// What is told, in order: name, value, standard deviation, unit.
    fn figures(&self) -> [(&'static str, f64, f64, &'static str); 6] {
        let [middle, turn] = self.sigma;
        let mm = |value: f64| 1e3 * value;
        [
            ("thickness", mm(self.middle.z), mm(middle.z), "mm"),
            ("offset to the right", mm(self.middle.x), mm(middle.x), "mm"),
            ("offset down", mm(self.middle.y), mm(middle.y), "mm"),
            ("turn", self.turn.to_degrees(), turn.z.to_degrees(), "deg"),
            ("tilt about the right axis", self.tilt[0].to_degrees(), turn.x.to_degrees(), "deg"),
            ("tilt about the down axis", self.tilt[1].to_degrees(), turn.y.to_degrees(), "deg"),
        ]
    }

    /// The same for programs: `back_thickness_mm`, `back_thickness_mm_sigma` and so on.
    pub fn measures(&self) -> BTreeMap<String, f64> {
        let named = self.figures().into_iter().flat_map(|(name, value, sigma, unit)| {
            let name = format!("back_{}_{unit}", name.replace(' ', "_"));
            let sigma = sigma.is_finite().then(|| (format!("{name}_sigma"), sigma));
            std::iter::once((name, value)).chain(sigma)
        });
        named.collect()
    }

    /// The same for people.
    pub fn table(&self) -> Table {
        let [thickness, right, down, turn, tilts @ ..] = self.figures();
        let with = |(_, value, sigma, _): (&str, f64, f64, &str)| {
            let digits = digits(sigma);
            format!("{value:.digits$} ± {sigma:.digits$}")
        };
        let note = format!(
            "the back is {} mm behind the front, its middle {} mm to the right and {} mm down as seen from the front, turned by {} \
             degrees in its plane and tilted by {} and {} about the axes to the right and down",
            with(thickness),
            with(right),
            with(down),
            with(turn),
            with(tilts[0]),
            with(tilts[1]),
        );
        let row = |(name, value, sigma, unit): (&str, f64, f64, &str)| {
            let digits = digits(sigma);
            vec![name.to_owned(), format!("{value:.digits$}"), format!("{sigma:.digits$}"), unit.to_owned()]
        };
        Table {
            title: "The back of the board".into(),
            note,
            head: ["", "Value", "Standard deviation", "Unit"].map(String::from).into(),
            rows: self.figures().map(row).into(),
        }
    }
}

/// Digits behind the point with which a standard deviation has two that mean something.
fn digits(sigma: f64) -> usize {
    if sigma > 0.0 && sigma.is_finite() { (1.0 - sigma.log10().floor()).clamp(0.0, 4.0) as usize } else { 3 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn known() -> SideUncertainty {
        SideUncertainty { rotation: DVec3::new(0.002, 0.003, 0.001), middle: DVec3::new(1e-4, 2e-4, 3e-4) }
    }

    #[test]
    fn a_stated_back_is_behind_the_front_and_told_as_it_was_stated() {
        for (front, back) in [
            ("charuco:5x4:0.05:0.04:DICT_4X4_50", "charuco:7x5:0.03:0.02:DICT_4X4_50:first=10"),
            ("aprilgrid:4x3:0.05:0.3", "aprilgrid:4x3:0.05:0.3:first=12"),
            ("aprilgrid:4x3:0.05:0.3", "charuco:5x4:0.05:0.04:DICT_4X4_50"),
            ("charuco:5x4:0.05:0.04:DICT_4X4_50", "aprilgrid:4x3:0.05:0.3"),
        ] {
            let plate = Plate::two_sided(front.parse().unwrap(), back.parse().unwrap()).unwrap();
            let (front, back) = (plate.front(), plate.back().unwrap());
            let pose = stated(front, back, 0.005);
            // The middles lie one behind the other, and what is below in front is below behind.
            let to_sheet = front.to_sheet();
            let behind = to_sheet * (pose.transform(back.middle()) - front.middle());
            assert!((behind - DVec3::new(0.0, 0.0, 0.005)).length() < 1e-12, "{behind}");
            let axis = |axis: DVec3| to_sheet * pose.rotation * back.to_sheet().conjugate() * axis;
            assert!((axis(DVec3::X) + DVec3::X).length() < 1e-12 && (axis(DVec3::Y) - DVec3::Y).length() < 1e-12);
            // Glued askew: 3 mm to the right, 2 mm up, turned by 4 degrees clockwise as seen from the front.
            let mut askew = side(back, pose, true);
            let turn = to_sheet.conjugate() * DVec3::Z * 4f64.to_radians();
            let shift = to_sheet.conjugate() * DVec3::new(0.003, -0.002, 0.0);
            let middle = pose.transform(back.middle()) + shift;
            let rotation = DQuat::from_scaled_axis(turn) * pose.rotation;
            askew.pose = Pose { rotation, translation: middle - rotation * back.middle() };
            let back_pose = BackPose::of(&plate, &askew, &known()).unwrap();
            let measures = back_pose.measures();
            for (name, value) in [
                ("thickness_mm", 5.0),
                ("offset_to_the_right_mm", 3.0),
                ("offset_down_mm", -2.0),
                ("turn_deg", 4.0),
                ("tilt_about_the_right_axis_deg", 0.0),
                ("thickness_mm_sigma", 0.3),
            ] {
                assert!((measures[&format!("back_{name}")] - value).abs() < 1e-9, "{name}: {measures:?}");
            }
            let words = back_pose.table().note;
            assert!(words.contains("5.00 ± 0.30 mm behind") && words.contains("turned by 4.000 ± 0.057"), "{words}");
            assert!(back_pose.warning().is_none() && back_pose.vagueness() < 0.1);
        }
    }

    #[test]
    fn a_back_that_is_glued_upside_down_is_turned_by_half_a_turn() {
        let plate = Plate::two_sided(
            "aprilgrid:4x3:0.05:0.3".parse().unwrap(),
            "aprilgrid:4x3:0.05:0.3:first=12".parse().unwrap(),
        )
        .unwrap();
        let (front, back) = (plate.front(), plate.back().unwrap());
        let mut pose = stated(front, back, 0.005);
        let middle = pose.transform(back.middle());
        pose.rotation = DQuat::from_rotation_z(3.0) * pose.rotation;
        pose.translation = middle - pose.rotation * back.middle();
        let vague = SideUncertainty { rotation: DVec3::splat(f64::INFINITY), middle: DVec3::splat(0.1) };
        let back_pose = BackPose::of(&plate, &side(back, pose, true), &vague).unwrap();
        assert!(
            (back_pose.turn + 3.0).abs() < 1e-9 && back_pose.tilt.iter().all(|tilt| tilt.abs() < 1e-9),
            "{}",
            back_pose.turn
        );
        assert!(
            back_pose.vagueness() > 1.0 && back_pose.uncertainty() == "not at all" && back_pose.warning().is_some()
        );
        assert!(!back_pose.measures().contains_key("back_turn_deg_sigma"));
    }
}
