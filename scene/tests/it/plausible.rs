//! Lenses and poses of rigs, plausible and not, through every format that a rig is read from.

use std::path::{Path, PathBuf};

use erfgs_scene::{
    Distortion, Intrinsics, Modality, Pose,
    exchange::{self, Format, Unit},
    rig_file::{RigCamera, RigFile, Sigma},
};
use glam::{DQuat, DVec3};
use proptest::prelude::*;

const SIZE: [u32; 2] = [640, 480];

/// Every format, and the name of its file or folder.
const FORMATS: [(Format, &str); 9] = [
    (Format::Colmap, "model"),
    (Format::Kalibr, "camchain.yaml"),
    (Format::OpenCv, "opencv"),
    (Format::Ros, "ros"),
    (Format::Nerfstudio, "transforms.json"),
    (Format::Llff, "poses_bounds.npy"),
    (Format::Caliscope, "camera_array.toml"),
    (Format::Pose2sim, "Calib.toml"),
    (Format::Rig, "rig.json"),
];

fn lens() -> Intrinsics {
    let [width, height] = SIZE;
    Intrinsics { width, height, fx: 500.0, fy: 500.0, cx: 320.0, cy: 240.0, distortion: Distortion::None }
}

/// A camera at the origin, which Kalibr needs, and the one in question.
fn rig(intrinsics: Intrinsics, pose: Pose) -> RigFile {
    let camera = |name: &str, intrinsics, pose| RigCamera::new(name, Modality::Rgb, intrinsics, Some(pose));
    RigFile::new("board", true, vec![camera("a", lens(), Pose::IDENTITY), camera("b", intrinsics, pose)])
}

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    /// The rig as it comes back from a format; it is said that its lengths are metres, as kilometres are asked about otherwise.
    fn through(&self, rig: &RigFile, format: Format, name: &str) -> Result<RigFile, String> {
        let path: PathBuf = self.0.path().join(name);
        let _ = std::fs::remove_dir_all(&path);
        exchange::write(rig, format, &path).unwrap();
        exchange::read_in(&path, Some(Unit::Metre)).map_err(|error| error.to_string())
    }

    /// What is said of a rig that no format may read.
    fn refused(&self, rig: &RigFile, (format, name): (Format, &str), quantity: &str) {
        let message = self.through(rig, format, name).expect_err(&format!("{format}: {quantity}"));
        let stem = Path::new(name).file_stem().unwrap().to_string_lossy().into_owned();
        // A model of COLMAP is refused by its camera, whose file is the model's.
        let named = message.contains(&stem) || format == Format::Colmap;
        assert!(named && message.len() < 600, "{format}: {message}");
        assert!(message.contains(quantity) && message.contains("plausible"), "{format}: {message}");
    }
}

/// Beyond what any rig has.
fn huge() -> impl Strategy<Value = f64> {
    (13.0..308.0_f64, any::<bool>()).prop_map(|(power, below)| 10.0_f64.powf(power) * if below { -1.0 } else { 1.0 })
}

fn power(range: std::ops::Range<f64>) -> impl Strategy<Value = f64> {
    range.prop_map(|power| 10.0_f64.powf(power))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn lenses_and_poses_that_rigs_have_come_back(
        // From a fisheye to a microscope, which stands micrometres away, and a drone, which is kilometres off.
        focal in power(2.0..6.0),
        place in prop::array::uniform3(power(-6.0..5.0)),
        turn in prop::array::uniform3(-1.0..1.0_f64),
        off in prop::array::uniform2(-2e3..2e3_f64),
        bend in -0.3..0.3_f64,
    ) {
        let folder = Folder::new();
        let pose = Pose { rotation: DQuat::from_scaled_axis(turn.into()), translation: place.into() };
        let distortion = Distortion::BrownConrady([bend, -0.5 * bend, 1e-3 * bend, 0.0, 0.0, 0.0, 0.0, 0.0]);
        let intrinsics =
            Intrinsics { fx: focal, fy: focal, cx: 320.0 + off[0], cy: 240.0 + off[1], distortion, ..lens() };
        for (format, name) in FORMATS {
            let read = folder.through(&rig(intrinsics, pose), format, name);
            let camera = read.map(|read| read.cameras[1].clone());
            prop_assert!(camera.as_ref().is_ok_and(|camera| (camera.intrinsics.fx / focal - 1.0).abs() < 1e-9), "{format}: {camera:?}");
        }
    }

    #[test]
    fn one_number_that_no_camera_has_is_named_by_every_format(value in huge(), axis in 0..3_usize) {
        let folder = Folder::new();
        let mut far = Pose::IDENTITY;
        far.translation[axis] = value;
        for format in FORMATS {
            let lens_of = |change: &dyn Fn(&mut Intrinsics)| {
                let mut lens = lens();
                change(&mut lens);
                rig(lens, Pose::IDENTITY)
            };
            folder.refused(&lens_of(&|lens| (lens.fx, lens.fy) = (value, value)), format, "the focal length");
            if format.0 != Format::Llff {
                folder.refused(&lens_of(&|lens| lens.cy = value), format, "the principal point");
                let bent = |lens: &mut Intrinsics| lens.distortion = Distortion::BrownConrady([0.1, value, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
                folder.refused(&lens_of(&bent), format, "a distortion coefficient");
            }
            if format.0 != Format::Ros {
                folder.refused(&rig(lens(), far), format, "a coordinate of a position");
            }
            for short in [0.0, -value.abs(), 1e-9] {
                folder.refused(&lens_of(&|lens| (lens.fx, lens.fy) = (short, short)), format, "the focal length");
            }
            let sized = |size: [u32; 2]| lens_of(&|lens| [lens.width, lens.height] = size);
            // LLFF's sizes are refused as such.
            if format.0 != Format::Llff {
                folder.refused(&sized([65_535, 65_535]), format, "the picture");
                folder.refused(&sized([640, 70_000]), format, "a side of the picture");
            }
        }
    }

    #[test]
    fn offsets_and_deviations_of_rig_files_are_held_against_what_clocks_and_calibrations_tell(
        offset in power(-9.0..4.5),
        sigma in power(-9.0..4.0),
        value in huge(),
    ) {
        let folder = Folder::new();
        let through = |change: &dyn Fn(&mut RigCamera)| {
            let mut rig = rig(lens(), Pose::IDENTITY);
            change(&mut rig.cameras[1]);
            folder.through(&rig, Format::Rig, "rig.json")
        };
        let of = |centre: f64, turn: f64, time: f64| Sigma {
            centre_m: [Some(centre), None, Some(0.0)],
            rotation_deg: [None, Some(turn), None],
            time_offset_s: Some(time),
            ..Sigma::default()
        };
        prop_assert!(through(&|camera| camera.time_offset_s = -offset).is_ok());
        prop_assert!(through(&|camera| camera.sigma = Some(of(sigma, sigma, sigma))).is_ok());
        let says = |change: &dyn Fn(&mut RigCamera), quantity: &str| {
            let message = through(change).unwrap_err();
            assert!(message.contains(quantity) && message.contains("rig.json") && message.contains("camera b"), "{message}");
        };
        // 136 years, as a clock of 32 bits tells where it has none.
        for wrong in [4_294_967_295.0, value, -86_401.0] {
            says(&|camera| camera.time_offset_s = wrong, "a time offset");
        }
        for wrong in [value, -1e-3] {
            says(&|camera| camera.sigma = Some(of(wrong, 0.1, 0.1)), "deviation of a place");
            says(&|camera| camera.sigma = Some(of(0.1, wrong, 0.1)), "deviation of a turn");
            says(&|camera| camera.sigma = Some(of(0.1, 0.1, wrong)), "deviation of a time");
        }
    }
}

#[test]
fn a_rotation_that_is_none_is_refused() {
    let folder = Folder::new();
    for length in [0.0, 0.5, 2.0, 1e3] {
        let pose = Pose { rotation: DQuat::IDENTITY * length, translation: DVec3::ZERO };
        folder.refused(&rig(lens(), pose), (Format::Rig, "rig.json"), "quaternion");
    }
}
