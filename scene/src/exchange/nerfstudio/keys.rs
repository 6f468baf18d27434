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
    /// Nerfstudio's list of k1, k2, k3, k4, p1 and p2.
    pub(super) distortion_params: Option<Vec<Number>>,
}

/// The names of the coefficients, in the order of [`LensKeys::coefficients`].
const COEFFICIENTS: [&str; 8] = ["k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2"];

/// A focal length of one axis: pixels, or the field of view.
type Focal = [Option<Number>; 2];

impl LensKeys {
    /// These values, and those of `file` where they are absent. What has two names is one value: a frame that tells its focal length
    /// by an angle takes none in pixels from the file, and one that names its model takes no other's coefficients.
    ///
    /// # Errors
    /// If what is the frame's and what is the file's do not belong together.
    pub(super) fn over(&self, file: &Self) -> Result<Self, String> {
        let [across, down] = self.focal_over(file);
        let (camera_model, is_fisheye) = match (&self.camera_model, self.is_fisheye) {
            (None, None) => (file.camera_model.clone(), file.is_fisheye),
            own => (own.0.clone(), own.1),
        };
        self.check_list()?;
        file.check_list()?;
        let [k1, k2, k3, k4, k5, k6, p1, p2] = self.coefficients_over(file)?;
        let merged = Self {
            camera_model,
            is_fisheye,
            camera_angle_x: across[1],
            camera_angle_y: down[1],
            fl_x: across[0],
            fl_y: down[0],
            cx: self.cx.or(file.cx),
            cy: self.cy.or(file.cy),
            w: self.w.or(file.w),
            h: self.h.or(file.h),
            k1,
            k2,
            k3,
            k4,
            k5,
            k6,
            p1,
            p2,
            distortion_params: None,
        };
        self.check_size(file, &merged)?;
        Ok(merged)
    }

    /// The focal lengths across and down. Instant-NGP writes both angles beside `fl_x` alone, which is that of square pixels then.
    fn focal(&self) -> [Focal; 2] {
        [[self.fl_x, self.camera_angle_x], [self.fl_y, self.camera_angle_y.filter(|_| self.fl_x.is_none())]]
    }

    fn focal_over(&self, file: &Self) -> [Focal; 2] {
        let is_given = |focal: &Focal| focal.iter().any(Option::is_some);
        let ([own_x, own_y], [file_x, [file_y, angle_y]]) = (self.focal(), file.focal());
        let across = if is_given(&own_x) { own_x } else { file_x };
        let down = if is_given(&own_y) { own_y } else { [file_y, angle_y.filter(|_| across[0].is_none())] };
        [across, down]
    }

    fn coefficients(&self) -> [Option<Number>; 8] {
        let named = self.named();
        match self.distortion_params.as_deref() {
            Some(&[k1, k2, k3, k4, p1, p2]) => {
                [Some(k1), Some(k2), Some(k3), Some(k4), named[4], named[5], Some(p1), Some(p2)]
            }
            _ => named,
        }
    }

    /// Coefficients that have a name of their own.
    fn named(&self) -> [Option<Number>; 8] {
        [self.k1, self.k2, self.k3, self.k4, self.k5, self.k6, self.p1, self.p2]
    }

    /// Refuses a list of coefficients of another length, or beside others by name.
    fn check_list(&self) -> Result<(), String> {
        let Some(list) = &self.distortion_params else { return Ok(()) };
        if list.len() != 6 {
            let count = list.len();
            return Err(format!(
                "distortion_params has {count} numbers, and k1, k2, k3, k4, p1, p2 are six; write them by name"
            ));
        }
        let differs = |(named, listed): (Option<Number>, Option<Number>)| named.is_some() && named != listed;
        match std::iter::zip(self.named(), self.coefficients()).position(differs) {
            Some(at) => Err(format!(
                "{} and distortion_params contradict each other; remove the one that is wrong",
                COEFFICIENTS[at]
            )),
            None => Ok(()),
        }
    }

    /// Those of the frame, and those of the file where they are of the same model.
    fn coefficients_over(&self, file: &Self) -> Result<[Option<Number>; 8], String> {
        let (own, others) = (self.coefficients(), file.coefficients());
        let is_model_own = self.camera_model.is_some() || self.is_fisheye.is_some();
        if !is_model_own || self.model() == file.model() {
            return Ok(std::array::from_fn(|at| own[at].or(others[at])));
        }
        let bent = others.iter().position(|k| k.is_some_and(|Number(k)| k != 0.0));
        match bent.filter(|_| own.iter().all(Option::is_none)) {
            Some(at) => Err(format!(
                "it names the camera model {} and no coefficients, and {} of the file is one of {}; give it its own, or 0",
                self.model().escape_debug(),
                COEFFICIENTS[at],
                file.model().escape_debug()
            )),
            None => Ok(own),
        }
    }

    /// The camera model, as it is named or by Instant-NGP's word.
    pub(super) fn model(&self) -> &str {
        match &self.camera_model {
            Some(model) => model,
            None if self.is_fisheye == Some(true) => "OPENCV_FISHEYE",
            None => "OPENCV",
        }
    }

    /// Pixels of the file are those of its images, and no frame of another size can take them.
    fn check_size(&self, file: &Self, merged: &Self) -> Result<(), String> {
        let differs = |own: Option<Number>, other: Option<Number>| own.is_some() && other.is_some() && own != other;
        if !differs(self.w, file.w) && !differs(self.h, file.h) {
            return Ok(());
        }
        let taken = [
            ("fl_x", self.fl_x.is_none() && merged.fl_x.is_some()),
            ("fl_y", self.fl_y.is_none() && merged.fl_y.is_some()),
            ("cx", self.cx.is_none() && merged.cx.is_some()),
            ("cy", self.cy.is_none() && merged.cy.is_some()),
        ];
        let taken: Vec<&str> = taken.into_iter().filter(|(_, is_taken)| *is_taken).map(|(name, _)| name).collect();
        if taken.is_empty() {
            return Ok(());
        }
        Err(format!(
            "its w and h are others than the file's, of whose images {} {} pixels; give it its own",
            taken.join(", "),
            if taken.len() == 1 { "is in" } else { "are in" }
        ))
    }
}
