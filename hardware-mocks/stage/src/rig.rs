//! Where the cameras stand: on an arc before the scene, no two at one place, each with its own lens.

use erfgs_base::random;
use erfgs_scene::{Distortion, Intrinsics, Pose};
use glam::DVec3;

use super::StageError;

/// What a camera is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// Records frames, for training.
    Rgb,
    /// Records events, for training.
    Event,
    /// Records sharp frames with masks, held out.
    Test,
}

impl Role {
    /// The first part of the names of such cameras.
    #[must_use]
    pub fn prefix(self) -> &'static str {
        match self {
            Self::Rgb => "rgb",
            Self::Event => "event",
            Self::Test => "test",
        }
    }
}

/// One camera of the rig.
#[derive(Clone, Debug, PartialEq)]
pub struct RigCamera {
    /// `rgb00`, `event00`, `test00`, ...
    pub name: String,
    /// What it is for.
    pub role: Role,
    /// Its lens: an ideal pinhole with its own focal length and an off-centre principal point.
    pub intrinsics: Intrinsics,
    /// Where it stands.
    pub world_to_camera: Pose,
}

/// How many cameras there are, and where.
#[derive(Clone, Debug, PartialEq)]
pub struct RigOptions {
    /// Image width, pixels.
    pub width: u32,
    /// Image height, pixels.
    pub height: u32,
    /// How many RGB cameras.
    pub rgb: usize,
    /// How many event cameras.
    pub event: usize,
    /// How many held-out cameras.
    pub test: usize,
    /// Angle of the arc that the cameras stand on, degrees, at most 100 (the room's walls end it).
    pub arc_degrees: f64,
    /// Distance from the centre of the scene, metres.
    pub distance: f64,
}

impl Default for RigOptions {
    fn default() -> Self {
        Self { width: 160, height: 120, rgb: 10, event: 4, test: 2, arc_degrees: 92.0, distance: 2.3 }
    }
}

/// What the cameras look at, metres.
pub const CENTRE: DVec3 = DVec3::new(0.0, -0.95, 0.25);
/// The longest side of an image, pixels.
pub const MOST_PIXELS: u32 = 8192;
/// The most cameras of one rig.
pub const MOST_CAMERAS: usize = 256;

const PLACE: u64 = random::purpose("stage camera place");
const LENS: u64 = random::purpose("stage camera lens");

impl RigOptions {
    /// The cameras, RGB first, then event, then test. The seed moves each a few centimetres and chooses its lens.
    ///
    /// # Errors
    /// If there are none or too many, or a size, angle or distance is out of range.
    pub fn cameras(&self, seed: u64) -> Result<Vec<RigCamera>, StageError> {
        let count = self.rgb.saturating_add(self.event).saturating_add(self.test);
        if count == 0 {
            return Err(StageError::NoCameras);
        }
        if count > MOST_CAMERAS {
            return Err(StageError::TooManyCameras { count, most: MOST_CAMERAS });
        }
        if [self.width, self.height].iter().any(|side| !(1..=MOST_PIXELS).contains(side)) {
            return Err(StageError::Size { width: self.width, height: self.height, most: MOST_PIXELS });
        }
        let arc = self.arc_degrees;
        StageError::check("the arc of the cameras, degrees,", arc, (1.0..=100.0).contains(&arc), "1 to 100")?;
        let distance = self.distance;
        StageError::check(
            "the distance of the cameras, metres,",
            distance,
            (1.5..=2.4).contains(&distance),
            "1.5 to 2.4",
        )?;
        let roles = [(Role::Rgb, self.rgb), (Role::Event, self.event), (Role::Test, self.test)];
        Ok(roles
            .into_iter()
            .flat_map(|(role, count)| (0..count).map(move |index| (role, index, count)))
            .map(|(role, index, count)| self.camera(seed, role, index, count))
            .collect())
    }

    fn camera(&self, seed: u64, role: Role, index: usize, count: usize) -> RigCamera {
        let place = random::key(seed, &[PLACE, role as u64, index as u64]);
        let lens = random::key(seed, &[LENS, role as u64, index as u64]);
        let jitter = |word, size: f64| size * (2.0 * random::uniform(random::extend(place, word)) - 1.0);
        // Each role has its own distance, which keeps the viewpoints apart, its share of the arc and its heights.
        let (nearer, share, low, high) = match role {
            Role::Rgb => (0.0, 1.0, 0.75, 1.75),
            Role::Event => (0.1, 0.86, 1.1, 1.5),
            Role::Test => (-0.1, 0.62, 1.3, 0.95),
        };
        let along = (index as f64 + 0.5) / count as f64 - 0.5;
        let azimuth =
            (share * self.arc_degrees * along).to_radians() + jitter(0, 0.2 / count as f64).clamp(-0.03, 0.03);
        let height = low + (high - low) * radical_inverse(index) + jitter(1, 0.04);
        let out = self.distance - nearer + jitter(2, 0.03);
        let eye = DVec3::new(CENTRE.x + out * azimuth.sin(), -height, CENTRE.z - out * azimuth.cos());
        let target = CENTRE + DVec3::new(jitter(3, 0.05), jitter(4, 0.05), jitter(5, 0.05));
        let (width, height) = (f64::from(self.width), f64::from(self.height));
        let wobble = |word, size: f64| size * (2.0 * random::uniform(random::extend(lens, word)) - 1.0);
        // The focal length goes by the diagonal, so that wide and tall images see the scene alike.
        let focal = 0.68 * width.hypot(height) * (1.0 + wobble(0, 0.03));
        let intrinsics = Intrinsics {
            width: self.width,
            height: self.height,
            fx: focal,
            fy: focal * (1.0 + wobble(1, 0.004)),
            cx: width * (0.5 + wobble(2, 0.025)),
            cy: height * (0.5 + wobble(3, 0.025)),
            distortion: Distortion::None,
        };
        RigCamera {
            name: format!("{}{index:02}", role.prefix()),
            role,
            intrinsics,
            world_to_camera: Pose::look_at(eye, target, DVec3::Y),
        }
    }
}

/// Van der Corput's sequence in base 2: 0, 1/2, 1/4, 3/4, ... spreads any number of heights evenly.
fn radical_inverse(index: usize) -> f64 {
    f64::from((index as u32).reverse_bits()) / 4_294_967_296.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::set::{ROOM_HIGH, ROOM_LOW};

    #[test]
    fn viewpoints_are_disjoint_inside_the_room_and_see_the_centre() {
        for (seed, arc_degrees, distance) in
            [(0, 92.0, 2.3), (1, 100.0, 2.4), (2, 100.0, 1.5), (3, 92.0, 2.3), (4, 60.0, 2.4)]
        {
            let options = RigOptions { rgb: 24, event: 8, test: 5, arc_degrees, distance, ..RigOptions::default() };
            let cameras = options.cameras(seed).unwrap();
            for (index, camera) in cameras.iter().enumerate() {
                let eye = camera.world_to_camera.centre();
                assert!(eye.cmpgt(ROOM_LOW + 0.02).all() && eye.cmplt(ROOM_HIGH - 0.02).all(), "{eye}");
                let seen = camera.intrinsics.project_pinhole(camera.world_to_camera.transform(CENTRE));
                assert!((seen.x / 160.0 - 0.5).abs() < 0.1 && (seen.y / 120.0 - 0.5).abs() < 0.1, "{seen}");
                for other in &cameras[..index] {
                    let gap = (other.world_to_camera.centre() - eye).length();
                    assert!(gap > 0.02, "{} and {} are {gap} m apart", camera.name, other.name);
                    assert_ne!(camera.name, other.name);
                }
            }
        }
    }

    #[test]
    fn impossible_rigs_are_typed_errors() {
        let ok = RigOptions::default();
        let none = RigOptions { rgb: 0, event: 0, test: 0, ..ok.clone() };
        assert!(matches!(none.cameras(1), Err(StageError::NoCameras)));
        let many = RigOptions { rgb: usize::MAX, event: 2, ..ok.clone() };
        assert!(matches!(many.cameras(1), Err(StageError::TooManyCameras { .. })));
        for (width, height) in [(0, 120), (160, 0), (u32::MAX, 1)] {
            assert!(matches!(RigOptions { width, height, ..ok.clone() }.cameras(1), Err(StageError::Size { .. })));
        }
        for arc_degrees in [0.0, -5.0, f64::NAN, 180.0] {
            assert!(matches!(RigOptions { arc_degrees, ..ok.clone() }.cameras(1), Err(StageError::Range { .. })));
        }
        assert!(RigOptions { width: 1, height: 1, rgb: 1, event: 0, test: 0, ..ok }.cameras(1).is_ok());
    }
}
