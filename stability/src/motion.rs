//! Gaussians that are free in time at the edges of what lives and velocities may be: the kernels against the `f64` twin.

use erfgs_base::random::{key, range};
use erfgs_splat::{
    field::{Outputs, Tape},
    gpu::Gpu,
    motion::{ClockRow, FreeTime, FreeTimeOptions, Motion, MotionRows, Supervision, free_time::ROW},
    raster::Deltas,
    reference::free_time as twin,
};

use crate::{Bound, Case, Expected, Measured, Refusal, Size};

const PART: &str = "motion, free in time";

/// Its name, and the truth of its cases.
pub(crate) const ABOUT: [&str; 2] = [
    PART,
    "Three hundred Gaussians that are free in time, against the `f64` twin; the error of a number is counted in what the roundings of f32 may make of it.",
];

const PLACES: &str = "eight roundings of f32 of the place, and one of the time times the velocity";
const LOGITS: &str = "twelve roundings of f32 of the logit, and one of the time over the life";
const CORE: usize = 12;
const ROWS: u64 = 300;
/// Half a unit in the last place of a number in f32, over the number.
const HALF_ULP: f64 = 1.0 / 16_777_216.0;

/// What the rows of a case are drawn from.
#[derive(Clone, Copy)]
struct Draw {
    /// RGB intervals that the recording spans.
    intervals: f32,
    /// Largest velocity along an axis, metres an interval.
    velocity: f64,
    /// Life, intervals.
    life: f64,
    /// How many lives before or after its instant a row is looked at, at most.
    lives: f64,
}

/// Where the recording is looked at.
const T01: f32 = 0.43;

impl Draw {
    fn options(&self) -> FreeTimeOptions {
        FreeTimeOptions { least_life: 0.0, ..FreeTimeOptions::default() }
    }

    /// Rows and logits, as single precision holds them.
    fn rows(&self) -> (Vec<f32>, Vec<f32>) {
        let time = f64::from(T01 * self.intervals);
        let row = |index: u64| {
            let at = |word: u64, most: f64| range(key(77, &[index, word]), -most, most);
            let instant = time + at(3, self.lives * self.life);
            let velocity = [0, 1, 2].map(|axis| at(axis, self.velocity));
            let bend = [4, 5, 6].map(|axis| at(axis, 0.1 * self.velocity));
            [velocity[0], velocity[1], velocity[2], instant, bend[0], bend[1], bend[2], self.life.ln()]
                .map(|x| x as f32)
        };
        let logit = |index: u64| range(key(78, &[index]), -3.0, 5.0) as f32;
        ((0..ROWS).flat_map(row).collect(), (0..ROWS).map(logit).collect())
    }

    /// The changes of place and logit, and how many numbers of the gradients are not finite.
    fn device(&self, gpu: &Gpu) -> Result<(Vec<f32>, u64), Refusal> {
        let (values, logits) = self.rows();
        let mut core = vec![0.0_f32; logits.len() * CORE];
        core.chunks_exact_mut(CORE).zip(&logits).for_each(|(row, logit)| row[10] = *logit);
        let count = logits.len();
        let mut motion = Motion::FreeTime(Box::new(FreeTime::new(gpu, &self.options(), self.intervals, 2.0)?));
        let core = gpu.storage_from("core", &core)?;
        let values = gpu.storage_from("rows", &values)?;
        let d_core = gpu.storage("gradients of the core", (4 * count * CORE) as u64)?;
        let gradients = gpu.storage("gradients of the rows", (4 * count * ROW) as u64)?;
        let rows = MotionRows { core: &core, count: count as u32, values: &values, gradients: &gradients };
        let mut tape = Tape::new(gpu)?;
        motion.forward(gpu, rows, T01, &mut tape, Outputs::All)?;
        let d_deltas = Deltas::new(gpu, "gradients of the changes", count as u32, None)?;
        gpu.upload(&d_deltas.core, 0, &vec![0.5_f32; count * CORE]);
        motion.backward(gpu, rows, &tape, &d_deltas, &d_core, Supervision::Frame(1.0))?;
        let clock = gpu.storage("clock", 4 * ClockRow::FLOATS as u64)?;
        motion.clock(gpu, rows, &tape, &d_deltas, ClockRow { sums: &clock, row: 0 });
        let mut not_finite = 0;
        for (buffer, floats) in [(&d_core, CORE * count), (&gradients, ROW * count), (&clock, ClockRow::FLOATS)] {
            let values: Vec<f32> = gpu.download(buffer, floats)?;
            not_finite += values.iter().filter(|value| !value.is_finite()).count() as u64;
        }
        Ok((gpu.download(&tape.deltas.core, CORE * count)?, not_finite))
    }

    fn moment(&self) -> twin::Moment {
        let options = self.options();
        twin::Moment {
            time: f64::from(T01 * self.intervals),
            knots: 0,
            spacing: 1.0,
            least: 0.0,
            path: 1.0,
            weight_presence: f64::from(options.weight_presence),
            weight_acceleration: f64::from(options.weight_acceleration),
        }
    }

    /// What the numbers of a row may be off by: place and logit.
    fn may(&self, row: &[f64], logit: f64, moved: [f64; 3], changed: f64) -> ([f64; 3], f64) {
        let dt = moved_by(row, self.moment().time);
        let off = HALF_ULP * dt.abs();
        let place = std::array::from_fn(|axis| {
            let (velocity, bend) = (row[axis], row[4 + axis]);
            let size = (velocity * dt).abs() + (0.5 * bend * dt * dt).abs() + moved[axis].abs();
            8.0 * HALF_ULP * size + off * (velocity.abs() + (bend * dt).abs()) + f64::from(f32::MIN_POSITIVE)
        });
        let life = row[7].exp();
        let u = dt / life;
        // The life is an exponential, whose argument is rounded.
        let logs = u * u * (16.0 + 4.0 * row[7].abs()) * HALF_ULP;
        (place, 12.0 * HALF_ULP * (1.0 + changed.abs() + logit.abs()) + logs + u.abs() * off / life)
    }

    /// The largest errors, over what they may be.
    fn measure(&self, gpu: &Gpu, places: bool) -> Result<Measured, Refusal> {
        let (deltas, not_finite) = self.device(gpu)?;
        let (values, logits) = self.rows();
        let mut measured = Measured { error: 0.0, not_finite };
        for ((delta, row), logit) in deltas.chunks_exact(CORE).zip(values.chunks_exact(ROW)).zip(logits) {
            let row: Vec<f64> = row.iter().copied().map(f64::from).collect();
            let logit = f64::from(logit);
            let (moved, changed) = twin::forward(logit, &row, &self.moment());
            let (may_move, may_change) = self.may(&row, logit, moved, changed);
            let of =
                |computed: f32, truth: f64, may: f64| Measured::between([f64::from(computed) / may], [truth / may]);
            measured = measured.and(if places {
                (0..3).map(|axis| of(delta[axis], moved[axis], may_move[axis])).fold(Measured::default(), Measured::and)
            } else {
                of(delta[10], changed, may_change)
            });
        }
        Ok(measured)
    }
}

fn moved_by(row: &[f64], time: f64) -> f64 {
    time - row[3]
}

/// The cases of motion.
#[must_use]
pub fn cases(size: Size) -> Vec<Case> {
    let usual = Draw { intervals: 30.0, velocity: 0.1, life: 1.0, lives: 3.0 };
    let mut draws: Vec<(String, Draw)> = vec![("lives of an interval, for comparison".into(), usual)];
    for decade in [-6, -4, -2, 2, 4, 6] {
        if size == Size::Full || [-6, 6].contains(&decade) {
            let life = 10_f64.powi(decade);
            draws.push((format!("lives of 1e{decade} intervals"), Draw { life, ..usual }));
        }
    }
    // 1 km/s at 30 frames a second, and at 1000.
    draws.push(("1 km/s at 30 frames a second".into(), Draw { velocity: 1000.0 / 30.0, ..usual }));
    draws.push((
        "1 km/s at 30 frames a second, lives of 1e6 intervals".into(),
        Draw { velocity: 1000.0 / 30.0, life: 1e6, ..usual },
    ));
    draws.push(("a recording of 1 ms, one interval".into(), Draw { intervals: 1.0, ..usual }));
    draws.push((
        "a recording of 1 h at 30 frames a second, 1 km/s".into(),
        Draw { intervals: 108_000.0, velocity: 1000.0 / 30.0, ..usual },
    ));
    let case = |(name, draw): (String, Draw)| {
        [(true, "places", PLACES), (false, "opacities", LOGITS)].map(|(places, what, why)| {
            let bound = Bound { most: 1.0, unit: "of the roundings", why };
            Case::new(PART, format!("{name}: {what}"), Expected::Within(bound), move |bench| {
                draw.measure(&bench.gpu, places)
            })
        })
    };
    draws.into_iter().flat_map(case).collect()
}
