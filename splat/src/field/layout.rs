//! Where every parameter of a field lies in one flat vector of f32: all planes, then the MLP.

use erfgs_base::random;

use super::{FieldConfig, FieldError, HeadInit};

/// The time axis in [`Plane::axes`].
pub const TIME: usize = 3;

/// The axes of the six planes of a level, in order: xy, xz, xt, yz, yt, zt.
pub const PLANE_AXES: [[usize; 2]; 6] = [[0, 1], [0, 2], [0, TIME], [1, 2], [1, TIME], [2, TIME]];

/// A plane: `rows` x `cols` cells of `features` values, row-major, features innermost.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Plane {
    /// Index of its level in the configuration.
    pub level: usize,
    /// The axes along its columns and its rows (0 to 2 for x to z, 3 for time). 4DGS stores `[feature, row, column]`.
    pub axes: [usize; 2],
    /// Cells along `axes[0]`.
    pub cols: usize,
    /// Cells along `axes[1]`.
    pub rows: usize,
    /// Its first value in the flat vector.
    pub offset: usize,
}

impl Plane {
    /// Whether its rows run over time.
    #[must_use]
    pub fn is_time(&self) -> bool {
        self.axes[1] == TIME
    }

    /// Such as `grid.level0.xt`.
    #[must_use]
    pub fn name(&self) -> String {
        let letter = |axis: usize| ["x", "y", "z", "t"][axis];
        format!("grid.level{}.{}{}", self.level, letter(self.axes[0]), letter(self.axes[1]))
    }
}

/// A linear layer: weights `outputs` x `inputs`, row-major, as PyTorch has them, and `outputs` biases.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Linear {
    /// Such as `trunk.0` or `head.position.1`.
    pub name: String,
    /// Values that go in: columns of the weights.
    pub inputs: usize,
    /// Values that come out: rows of the weights.
    pub outputs: usize,
    /// Its first weight in the flat vector.
    pub weight: usize,
    /// Its first bias in the flat vector.
    pub bias: usize,
}

/// Where the outputs of a head go.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Target {
    /// To the core deltas, from this column on.
    Core(usize),
    /// To the SH deltas.
    Sh,
}

/// A head: ReLU, `hidden`, ReLU, `out`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Head {
    /// Its first layer, width x width. Those of all heads lie one behind the other, weights and biases each, so that
    /// they are one product.
    pub hidden: Linear,
    /// Its second layer.
    pub out: Linear,
    /// Where its outputs go.
    pub target: Target,
}

/// The parts of a field.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Layout {
    /// The configuration that it was made from.
    pub config: FieldConfig,
    /// The planes, level by level, six each in the order of [`PLANE_AXES`].
    pub planes: Vec<Plane>,
    /// Floats of all planes: the MLP starts here.
    pub grid: usize,
    /// The layers of the trunk, with a ReLU between each two.
    pub trunk: Vec<Linear>,
    /// The heads that are on; position first if it is.
    pub heads: Vec<Head>,
    /// Floats of everything.
    pub total: usize,
}

impl Layout {
    /// Lays a field out.
    ///
    /// # Errors
    /// [`FieldError::Config`].
    pub fn new(config: &FieldConfig) -> Result<Self, FieldError> {
        validate(config)?;
        let features = config.features as usize;
        let width = config.width as usize;
        let (mut planes, mut end) = (Vec::new(), 0);
        for (level, multiplier) in config.levels.iter().enumerate() {
            let cells = |axis: usize| match axis {
                TIME => config.time_resolution as usize,
                _ => config.spatial_resolution[axis] as usize * *multiplier as usize,
            };
            for axes in PLANE_AXES {
                let [cols, rows] = axes.map(cells);
                planes.push(Plane { level, axes, cols, rows, offset: end });
                end += rows * cols * features;
            }
        }
        let grid = end;
        let mut take = |count: usize| {
            end += count;
            end - count
        };
        let trunk = (0..config.depth.max(1) as usize)
            .map(|layer| {
                let inputs = if layer == 0 { features * config.levels.len() } else { width };
                let (weight, bias) = (take(width * inputs), take(width));
                Linear { name: format!("trunk.{layer}"), inputs, outputs: width, weight, bias }
            })
            .collect();
        let on = config.heads;
        let kinds: Vec<_> = [
            (on.position, "position", 3, Target::Core(0)),
            (on.scale, "scale", 3, Target::Core(3)),
            (on.rotation, "rotation", 4, Target::Core(6)),
            (on.opacity, "opacity", 1, Target::Core(10)),
            (on.sh, "sh", sh_channels(config.sh_stride), Target::Sh),
        ]
        .into_iter()
        .filter(|(on, ..)| *on)
        .collect();
        let (weights, biases) = (take(kinds.len() * width * width), take(kinds.len() * width));
        let heads = kinds
            .into_iter()
            .enumerate()
            .map(|(slot, (_, name, outputs, target))| {
                let hidden = Linear {
                    name: format!("head.{name}.0"),
                    inputs: width,
                    outputs: width,
                    weight: weights + slot * width * width,
                    bias: biases + slot * width,
                };
                let (weight, bias) = (take(outputs * width), take(outputs));
                let out = Linear { name: format!("head.{name}.1"), inputs: width, outputs, weight, bias };
                Head { hidden, out, target }
            })
            .collect();
        Ok(Self { config: config.clone(), planes, grid, trunk, heads, total: end })
    }

    /// Features of a point: those of all levels, one behind the other.
    #[must_use]
    pub fn point_features(&self) -> usize {
        self.config.features as usize * self.config.levels.len()
    }

    /// The heads of a pass: all, or the position head alone.
    #[must_use]
    pub fn heads_of(&self, what: super::Outputs) -> &[Head] {
        match what {
            super::Outputs::All => &self.heads,
            super::Outputs::PositionOnly => &self.heads[..usize::from(self.config.heads.position)],
        }
    }

    /// Row of the time planes at `t01` (clamped to [0, 1]), as the lower row and the weight of the next one.
    #[must_use]
    pub fn time_row(&self, t01: f32) -> (usize, f32) {
        let t = if t01 > 0.0 { t01.min(1.0) } else { 0.0 };
        let along = match self.config.time_axis {
            super::TimeAxis::UpperHalf => 0.5 + 0.5 * t,
            super::TimeAxis::Full => t,
        };
        locate(along, self.config.time_resolution as usize)
    }

    /// Name, place and length of every vector of a saved state.
    #[must_use]
    pub fn vectors(&self) -> Vec<(String, usize, usize)> {
        let features = self.config.features as usize;
        let planes = self.planes.iter().map(|plane| (plane.name(), plane.offset, plane.rows * plane.cols * features));
        let linears = self.trunk.iter().chain(self.heads.iter().flat_map(|head| [&head.hidden, &head.out]));
        let linears = linears.flat_map(|linear| {
            let weights = (format!("{}.weight", linear.name), linear.weight, linear.inputs * linear.outputs);
            [weights, (format!("{}.bias", linear.name), linear.bias, linear.outputs)]
        });
        planes.chain(linears).collect()
    }

    /// Initial parameters: spatial planes uniform in [0.1, 0.5], time planes 1, Xavier-uniform weights, biases uniform
    /// within 1 / sqrt(inputs), as in 4DGS; the last layer of each head as configured.
    #[must_use]
    pub fn initial(&self, seed: u64) -> Vec<f32> {
        const PURPOSE: u64 = random::purpose("deformation field");
        let mut values = vec![0.0; self.total];
        let mut fill = |tensor: usize, offset: usize, length: usize, low: f64, high: f64| {
            let key = random::key(seed, &[PURPOSE, tensor as u64]);
            for (index, value) in values[offset..offset + length].iter_mut().enumerate() {
                *value = random::range(random::extend(key, index as u64), low, high) as f32;
            }
        };
        for (tensor, plane) in self.planes.iter().enumerate() {
            let (low, high) = if plane.is_time() { (1.0, 1.0) } else { (0.1, 0.5) };
            fill(tensor, plane.offset, plane.rows * plane.cols * self.config.features as usize, low, high);
        }
        let zero_last = self.config.head_init == HeadInit::ZeroLast;
        let trunk = self.trunk.iter().map(|linear| (linear, false));
        let heads = self.heads.iter().flat_map(|head| [(&head.hidden, false), (&head.out, zero_last)]);
        for (index, (linear, zero)) in trunk.chain(heads).enumerate().filter(|(_, (_, zero))| !zero) {
            debug_assert!(!zero);
            let tensor = 1000 + 2 * index;
            let weight = (6.0 / (linear.inputs + linear.outputs) as f64).sqrt();
            fill(tensor, linear.weight, linear.inputs * linear.outputs, -weight, weight);
            let bias = 1.0 / (linear.inputs as f64).sqrt();
            fill(tensor + 1, linear.bias, linear.outputs, -bias, bias);
        }
        values
    }
}

/// The cell of `along` in [0, 1] on an axis of `cells` values whose first lies at 0 and last at 1 (`align_corners`), and
/// the weight of the next cell. The lower cell is never the last one. NaN lands on 0.
#[must_use]
pub fn locate(along: f32, cells: usize) -> (usize, f32) {
    let last = cells - 1;
    let position = (if along > 0.0 { along.min(1.0) } else { 0.0 }) * last as f32;
    let cell = (position as usize).min(last - 1);
    (cell, position - cell as f32)
}

/// SH values of a row without its padding.
fn sh_channels(sh_stride: u32) -> usize {
    match sh_stride {
        4 => 3,
        28 => 27,
        stride => stride as usize,
    }
}

fn validate(config: &FieldConfig) -> Result<(), FieldError> {
    let fail = |reason: String| Err(FieldError::Config { reason });
    if config.levels.is_empty()
        || config.levels.len() > 8
        || config.levels.iter().any(|level| !(1..=64).contains(level))
    {
        return fail(format!("1 to 8 levels of 1 to 64 are possible, not {:?}", config.levels));
    }
    if ![4, 8, 16, 32, 64].contains(&config.features) {
        return fail(format!("planes have 4, 8, 16, 32 or 64 features, not {}", config.features));
    }
    let resolutions = config.spatial_resolution.iter().chain([&config.time_resolution]);
    if let Some(bad) = resolutions.into_iter().find(|cells| !(2..=1024).contains(*cells)) {
        return fail(format!("axes have 2 to 1024 cells, not {bad}"));
    }
    if !(16..=1024).contains(&config.width) || !config.width.is_multiple_of(16) {
        return fail(format!("the width is a multiple of 16 from 16 to 1024, not {}", config.width));
    }
    if config.depth > 8 {
        return fail(format!("the trunk has at most 8 layers, not {}", config.depth));
    }
    if ![4, 12, 28, 48].contains(&config.sh_stride) {
        return fail(format!("rows of SH have 4, 12, 28 or 48 floats, not {}", config.sh_stride));
    }
    let on = config.heads;
    if !(on.position || on.scale || on.rotation || on.opacity || on.sh) {
        return fail("all heads are off".into());
    }
    let cells: u64 = config
        .levels
        .iter()
        .map(|level| {
            let [x, y, z] = config.spatial_resolution.map(|cells| u64::from(cells) * u64::from(*level));
            x * y + x * z + y * z + (x + y + z) * u64::from(config.time_resolution)
        })
        .sum();
    if cells * u64::from(config.features) > 1 << 29 {
        return fail(format!(
            "its planes would hold {} values; take fewer cells or levels",
            cells * u64::from(config.features)
        ));
    }
    Ok(())
}
