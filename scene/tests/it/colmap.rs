//! COLMAP reads our models, and we read what it makes of them.

use std::process::Command;

use erfgs_scene::{
    Distortion, Intrinsics, Pose,
    colmap::{ColmapCamera, ColmapImage, Model, Observation, Point2d, Point3d},
};
use glam::{DVec2, DVec3};

/// Three cameras, three images and two points that all of them see.
fn model() -> Model {
    let lenses = [
        Distortion::None,
        Distortion::BrownConrady([0.01, -0.002, 0.0003, -0.0004, 0.0, 0.0, 0.0, 0.0]),
        Distortion::KannalaBrandt([0.01, -0.002, 0.0003, -0.0004]),
    ];
    let positions = [DVec3::new(0.1, -0.2, 0.3), DVec3::new(-1.0 / 3.0, 0.25, 0.0)];
    let mut model = Model::default();
    for (index, distortion) in lenses.into_iter().enumerate() {
        let id = index as u32 + 1;
        let eye = DVec3::new(2.0 - index as f64, -1.0, 2.0);
        let pose = Pose::look_at(eye, DVec3::ZERO, DVec3::Y);
        let intrinsics = Intrinsics { width: 640, height: 480, fx: 500.1, fy: 501.2, cx: 320.3, cy: 239.9, distortion };
        let seen = positions.iter().zip(10..).map(|(point, id)| Point2d {
            position: intrinsics.project(pose.transform(*point)).unwrap(),
            point3d: Some(id),
        });
        let alone = Point2d { position: DVec2::new(0.5, 479.5), point3d: None };
        let points = seen.chain([alone]).collect();
        model.cameras.insert(id, ColmapCamera::from_intrinsics(&intrinsics));
        model.images.insert(id, ColmapImage { pose, camera: id, name: format!("cam{id:02}/00000.png"), points });
    }
    for (index, position) in positions.into_iter().enumerate() {
        let track = (1..=3).map(|image| Observation { image, point2d: index as u32 }).collect();
        let point = Point3d { position, colour: [200, 100, index as u8], error: 0.125, track };
        model.points.insert(10 + index as u64, point);
    }
    model
}

#[test]
fn colmap_reads_our_models_and_we_read_what_it_makes_of_them() {
    let folder = tempfile::tempdir().unwrap();
    let [ours, text, binary] = ["ours", "text", "binary"].map(|name| folder.path().join(name));
    model().write_binary(&ours).unwrap();
    for (from, to, form) in [(&ours, &text, "TXT"), (&text, &binary, "BIN")] {
        std::fs::create_dir(to).unwrap();
        let output = Command::new("colmap")
            .args(["model_converter", "--output_type", form, "--input_path"])
            .arg(from)
            .arg("--output_path")
            .arg(to)
            .output()
            .expect("COLMAP is installed by scripts/setup.sh");
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let (expected, found) = (model(), Model::read(to).unwrap());
        assert_eq!((&found.cameras, &found.points), (&expected.cameras, &expected.points), "{form}");
        assert_eq!(found.images.len(), 3);
        for (id, image) in &expected.images {
            let other = &found.images[id];
            assert_eq!((&other.name, other.camera, &other.points), (&image.name, image.camera, &image.points));
            assert!(other.pose.rotation.dot(image.pose.rotation) > 1.0 - 1e-15);
            assert!(other.pose.translation.distance(image.pose.translation) < 1e-15);
        }
    }
}
