//! A sink that keeps everything in memory.

use super::sink::{ApsFrame, CdEvent, Edge, EventBatch, ImuSample, Mark, Sink};

/// A sink that keeps all it is given: events in columns, the rest in rows.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Columns {
    /// Device times of the events, microseconds.
    pub t_us: Vec<u64>,
    /// Columns.
    pub x: Vec<u16>,
    /// Rows.
    pub y: Vec<u16>,
    /// Polarities.
    pub on: Vec<bool>,
    /// Edges at trigger inputs.
    pub edges: Vec<Edge>,
    /// Samples of the inertial unit.
    pub imu: Vec<ImuSample>,
    /// Frames.
    pub frames: Vec<ApsFrame>,
    /// Marks of iniVation sensors, with their times.
    pub marks: Vec<(u64, Mark)>,
    /// Reports of the sensor on itself: time, subtype, payload.
    pub monitor: Vec<(u64, u16, u64)>,
    /// Where time is not continuous: how many events came before, and the time that follows.
    pub discontinuities: Vec<(usize, u64)>,
}

impl Columns {
    /// No events yet, with room for `events`.
    #[must_use]
    pub fn with_capacity(events: usize) -> Self {
        Self {
            t_us: Vec::with_capacity(events),
            x: Vec::with_capacity(events),
            y: Vec::with_capacity(events),
            on: Vec::with_capacity(events),
            ..Self::default()
        }
    }

    /// How many events there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.t_us.len()
    }

    /// Whether there are no events.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.t_us.is_empty()
    }

    /// Forgets the events and keeps their room; the rest stays.
    pub fn clear_events(&mut self) {
        self.t_us.clear();
        self.x.clear();
        self.y.clear();
        self.on.clear();
    }

    /// The events one by one.
    pub fn iter(&self) -> impl Iterator<Item = CdEvent> + '_ {
        (0..self.len()).map(|at| CdEvent { t_us: self.t_us[at], x: self.x[at], y: self.y[at], on: self.on[at] })
    }
}

impl Sink for Columns {
    fn event(&mut self, CdEvent { t_us, x, y, on }: CdEvent) {
        self.t_us.push(t_us);
        self.x.push(x);
        self.y.push(y);
        self.on.push(on);
    }

    fn events(&mut self, batch: EventBatch<'_>) {
        self.t_us.extend_from_slice(batch.t_us);
        self.x.extend_from_slice(batch.x);
        self.y.extend_from_slice(batch.y);
        self.on.extend_from_slice(batch.on);
    }

    fn edge(&mut self, edge: Edge) {
        self.edges.push(edge);
    }

    fn imu(&mut self, sample: ImuSample) {
        self.imu.push(sample);
    }

    fn frame(&mut self, frame: ApsFrame) {
        self.frames.push(frame);
    }

    fn monitor(&mut self, t_us: u64, subtype: u16, payload: u64) {
        self.monitor.push((t_us, subtype, payload));
    }

    fn discontinuity(&mut self, t_us: u64) {
        self.discontinuities.push((self.len(), t_us));
    }

    fn mark(&mut self, t_us: u64, mark: Mark) {
        self.marks.push((t_us, mark));
        if let Some(edge) = mark.edge(t_us) {
            self.edge(edge);
        }
    }
}
