//! What is to be known of a file before its packets: its span and its addresses.

use super::{host_clock::HostClock, source::EventSource};
use crate::container::ContainerError;
use erfgs_events::{Anomalies, ApsFrame, CdEvent, Edge, ImuSample, Mark, SensorSize, Sink};

/// What was found.
pub(super) struct Survey {
    /// The earliest time, microseconds; 0 without any.
    pub first_us: u64,
    /// From there to the end, nanoseconds of host time; `None` if the file holds nothing.
    pub last_ns: Option<i64>,
    /// What of the file cannot be read.
    pub faults: Vec<String>,
    /// What holds all addresses and frames; `None` without any.
    pub extent: Option<SensorSize>,
}

#[derive(Default)]
struct Extent {
    /// The first time that came, and the earliest.
    first: Option<[u64; 2]>,
    clock: HostClock,
    width: u16,
    height: u16,
}

impl Extent {
    fn time(&mut self, t_us: u64) {
        match &mut self.first {
            Some([_, earliest]) => *earliest = t_us.min(*earliest),
            None => (self.first, self.clock) = (Some([t_us; 2]), HostClock::new(t_us)),
        }
        self.clock.host_ns(t_us);
    }

    fn reaches(&mut self, width: u16, height: u16) {
        (self.width, self.height) = (self.width.max(width), self.height.max(height));
    }
}

impl Sink for Extent {
    fn event(&mut self, event: CdEvent) {
        self.time(event.t_us);
        self.reaches(event.x.saturating_add(1), event.y.saturating_add(1));
    }

    fn edge(&mut self, edge: Edge) {
        self.time(edge.t_us);
    }

    fn mark(&mut self, t_us: u64, _mark: Mark) {
        self.time(t_us);
    }

    fn imu(&mut self, sample: ImuSample) {
        self.time(sample.t_us);
    }

    fn frame(&mut self, frame: ApsFrame) {
        self.time(frame.exposure_start_us);
        self.time(frame.exposure_end_us);
        self.reaches(frame.width, frame.height);
    }

    fn discontinuity(&mut self, t_us: u64) {
        self.clock.discontinuity(t_us);
    }
}

/// What anomalies say of a file that is cut or damaged, or whose events lie outside the sensor that it tells of. Others are
/// those of the device, whose own words (RAW) may be wrong.
fn faults(source: &EventSource, anomalies: &Anomalies, size_is_files: bool) -> Vec<String> {
    let mut faults = Vec::new();
    if let (true, Some(SensorSize { width, height })) = (anomalies.outside > 0 && size_is_files, source.size()) {
        faults.push(format!(
            "{} events lie outside the {width} x {height} pixels that it says and were left out: give the sensor's size with --size",
            anomalies.outside
        ));
    }
    if anomalies.damaged > 0 {
        faults.push(format!("{} lines or packets of it cannot be read", anomalies.damaged));
    }
    if anomalies.truncated_bytes > 0 {
        faults.push(format!("it is cut off: its last {} bytes are an incomplete item", anomalies.truncated_bytes));
    }
    faults
}

/// Reads the file through. `size_is_files`: the sensor's size is that which the file says.
pub(super) fn survey(source: &EventSource, size_is_files: bool) -> Result<Survey, ContainerError> {
    let mut extent = Extent::default();
    let anomalies = source.decode(&mut extent, |_| true)?;
    if anomalies.are_all(u64::from(extent.first.is_some())) {
        return Err(ContainerError::NothingReadable { path: source.path().to_owned(), found: anomalies.to_string() });
    }
    let before_ns =
        |[came, earliest]: [u64; 2]| i64::try_from(came - earliest).unwrap_or(i64::MAX).saturating_mul(1000);
    Ok(Survey {
        first_us: extent.first.map_or(0, |[_, earliest]| earliest),
        last_ns: extent.first.map(|first| extent.clock.last_ns().saturating_add(before_ns(first))),
        faults: faults(source, &anomalies, size_is_files && !source.is_devices_words()),
        extent: (extent.width > 0 && extent.height > 0)
            .then_some(SensorSize { width: extent.width, height: extent.height }),
    })
}
