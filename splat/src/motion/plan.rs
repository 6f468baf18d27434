//! How Gaussians move, as a file says it.

use serde::{Deserialize, Serialize};

use super::{Bodies, BodiesOptions, FreeTime, FreeTimeOptions, Motion, bodies};
use crate::{
    field::{Field, FieldConfig, FieldError, FieldState, Layout},
    gpu::Gpu,
};

/// Floats of a control point, and of a gate or a node.
const CONTROL: usize = 8;
const OTHER: usize = 4;

/// Which model moves the Gaussians, and what it needs to know beside what it learned.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", tag = "model", deny_unknown_fields)]
pub enum MotionPlan {
    /// Nothing moves.
    Still,
    /// A deformation field.
    HexPlane {
        /// Its shape.
        field: FieldConfig,
        /// Its box, metres.
        aabb: [[f32; 3]; 2],
    },
    /// A trajectory and a life for each Gaussian.
    FreeTime {
        /// What rows hold.
        options: FreeTimeOptions,
        /// RGB intervals in the recording.
        intervals: f64,
    },
    /// Bodies; the others are free in time.
    Bodies {
        /// What rows hold.
        options: FreeTimeOptions,
        /// RGB intervals in the recording.
        intervals: f64,
        /// How long it is.
        seconds: f64,
        /// What the bodies are called.
        names: Vec<String>,
        /// Nodes of all bodies together.
        nodes: usize,
        /// Control points of each path.
        knots: usize,
    },
}

impl MotionPlan {
    /// What the bodies are called, where there are any.
    #[must_use]
    pub fn bodies(&self) -> &[String] {
        match self {
            Self::Bodies { names, .. } => names,
            Self::Still | Self::HexPlane { .. } | Self::FreeTime { .. } => &[],
        }
    }

    /// The body that a row of a Gaussian hangs on, if one carries it.
    #[must_use]
    pub fn body_of(&self, row: &[f32]) -> Option<usize> {
        let Self::Bodies { options, names, .. } = self else { return None };
        let hangs = *row.get(options.floats())?;
        (hangs >= 1.0 && hangs <= names.len() as f32).then(|| hangs as usize - 1)
    }

    /// Floats that the model keeps for each Gaussian.
    #[must_use]
    pub fn row_floats(&self) -> usize {
        match self {
            Self::Still | Self::HexPlane { .. } => 0,
            Self::FreeTime { options, .. } => options.floats(),
            Self::Bodies { options, .. } => options.floats() + bodies::EXTRA_FLOATS,
        }
    }

    /// The model, with what all Gaussians share of it. It draws; its rates of learning are those of no training.
    ///
    /// # Errors
    /// [`FieldError`] where the plan cannot be, or what is shared is of another.
    pub fn motion(&self, gpu: &Gpu, shared: Option<&FieldState>) -> Result<Option<Motion>, FieldError> {
        let refused = |reason: String| FieldError::State { reason };
        // Of the scene's extent only learning takes notice.
        let extent = 1.0;
        let mut motion = match self {
            Self::Still => return Ok(None),
            Self::HexPlane { field, aabb } => {
                let floats = shared.map_or(0, |state| state.vectors.iter().map(|vector| vector.values.len()).sum());
                // Three of each: values and their moments.
                if Layout::new(field)?.total.checked_mul(3) != Some(floats) {
                    return Err(refused(format!("its field has {floats} numbers")));
                }
                Motion::HexPlane(Box::new(Field::new(gpu, field, *aabb, 0)?))
            }
            Self::FreeTime { options, intervals } => {
                options.check_path().map_err(|error| refused(error.to_string()))?;
                Motion::FreeTime(Box::new(FreeTime::new(gpu, options, *intervals as f32, extent)?))
            }
            Self::Bodies { options, intervals, seconds, .. } => {
                options.check_path().map_err(|error| refused(error.to_string()))?;
                let start =
                    self.start(shared).ok_or_else(|| refused("its bodies' paths are missing or too short".into()))?;
                let lengths = [*seconds, *intervals];
                let learning = BodiesOptions::default();
                Motion::Bodies(Box::new(Bodies::new(gpu, &start, &learning, options, lengths, extent)?))
            }
        };
        motion.restore(gpu, shared)?;
        Ok(Some(motion))
    }

    /// The bodies as they are drawn, where the vectors are as long as so many bodies ask for.
    fn start(&self, shared: Option<&FieldState>) -> Option<bodies::Start> {
        let Self::Bodies { names, nodes, knots, .. } = self else { return None };
        let vector = |name: &str| {
            let found = shared?.vectors.iter().find(|vector| vector.name == name)?;
            Some(found.values.clone())
        };
        let (control, other) = (vector("bodies.control")?, vector("bodies.other")?);
        let count = names.len().checked_add(*nodes)?;
        let fits = *knots >= 4
            && count.checked_mul(*knots)?.checked_mul(CONTROL)? == control.len()
            && count.checked_mul(OTHER)? == other.len();
        fits.then(|| bodies::Start {
            bodies: names.len(),
            names: names.clone(),
            followed: vec![false; names.len()],
            bends: vec![None; names.len()],
            nodes: *nodes,
            node_bodies: vec![0; *nodes],
            knots: *knots,
            per_second: 0.0,
            control,
            other,
            neighbours: vec![bodies::NO_NODE; nodes * bodies::NEIGHBOURS],
            gaussians: Default::default(),
        })
    }
}
