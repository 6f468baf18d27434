//! The keys of `transforms.json` as they stand in the file.

use std::collections::BTreeMap;

use serde::{Deserialize, de::IgnoredAny};

use crate::exchange::json::Number;

/// The file.
#[derive(Deserialize)]
pub(super) struct File {
    #[serde(flatten)]
    pub(super) lens: LensKeys,
    pub(super) frames: Vec<FrameKeys>,
    pub(super) train_filenames: Option<Vec<String>>,
    pub(super) val_filenames: Option<Vec<String>>,
    pub(super) test_filenames: Option<Vec<String>>,
    /// Everything else.
    #[serde(flatten)]
    pub(super) other: BTreeMap<String, IgnoredAny>,
}

/// A frame.
#[derive(Deserialize)]
pub(super) struct FrameKeys {
    pub(super) file_path: String,
    pub(super) transform_matrix: Vec<Vec<Number>>,
    pub(super) time: Option<Number>,
    #[serde(flatten)]
    pub(super) lens: LensKeys,
    /// Everything else.
    #[serde(flatten)]
    pub(super) other: BTreeMap<String, IgnoredAny>,
}

/// The intrinsics of the file or of a frame.
#[derive(Default, Deserialize)]
pub(super) struct LensKeys {
    pub(super) camera_model: Option<String>,
    /// Instant-NGP's word for OPENCV_FISHEYE.
    pub(super) is_fisheye: Option<bool>,
    pub(super) camera_angle_x: Option<Number>,
    pub(super) camera_angle_y: Option<Number>,
    pub(super) fl_x: Option<Number>,
    pub(super) fl_y: Option<Number>,
    pub(super) cx: Option<Number>,
    pub(super) cy: Option<Number>,
    pub(super) w: Option<Number>,
    pub(super) h: Option<Number>,
    pub(super) k1: Option<Number>,
    pub(super) k2: Option<Number>,
    pub(super) k3: Option<Number>,
    pub(super) k4: Option<Number>,
    pub(super) k5: Option<Number>,
    pub(super) k6: Option<Number>,
    pub(super) p1: Option<Number>,
    pub(super) p2: Option<Number>,
}

impl LensKeys {
    /// These values, and those of `file` where they are absent.
    pub(super) fn over(&self, file: &Self) -> Self {
        Self {
            camera_model: self.camera_model.clone().or_else(|| file.camera_model.clone()),
            is_fisheye: self.is_fisheye.or(file.is_fisheye),
            camera_angle_x: self.camera_angle_x.or(file.camera_angle_x),
            camera_angle_y: self.camera_angle_y.or(file.camera_angle_y),
            fl_x: self.fl_x.or(file.fl_x),
            fl_y: self.fl_y.or(file.fl_y),
            cx: self.cx.or(file.cx),
            cy: self.cy.or(file.cy),
            w: self.w.or(file.w),
            h: self.h.or(file.h),
            k1: self.k1.or(file.k1),
            k2: self.k2.or(file.k2),
            k3: self.k3.or(file.k3),
            k4: self.k4.or(file.k4),
            k5: self.k5.or(file.k5),
            k6: self.k6.or(file.k6),
            p1: self.p1.or(file.p1),
            p2: self.p2.or(file.p2),
        }
    }
}
