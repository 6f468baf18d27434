//! The test from end to end: open, record each device alone, record all together, judge.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    sync::{Arc, atomic::AtomicBool},
    time::{Duration, SystemTime, UNIX_EPOCH},
};

use erfgs_base::{FileError, calendar::DateTime, scratch::Scratch};
use erfgs_recorder::{DeviceConfig, DeviceSettings, Input, MachineFacts, RigConfig, open_on};
use erfgs_rig::usb::Bus;
use erfgs_session::source::Description;

use crate::{
    error::SelftestError,
    record::{Opened, Outcome, record},
    report::{DeviceReport, RecordedReport, Report, VERSION},
    shared::SharedSource,
    verdict::{Alone, DeviceFindings, Findings, Together, judge},
};

/// How a rig is tested.
pub struct Options<'a> {
    /// How long each recording is.
    pub length: Duration,
    /// A folder in which the recordings stay; `None`: they go when the test is over.
    pub keep: Option<PathBuf>,
    /// Set by who wants the test to end.
    pub stop: &'a AtomicBool,
}

/// What the test does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Step<'a> {
    /// A device is opened and set.
    Opening {
        /// Which.
        device: &'a str,
    },
    /// A recording runs.
    Recording {
        /// Of which device; `None`: of all.
        device: Option<&'a str>,
        /// Which share of it is done.
        share: f64,
    },
}

/// Tests a rig, with the USB devices of `bus`. `progress` is called with each step.
///
/// # Errors
/// If nothing can be recorded on this machine. What is wrong with a device is in the report.
pub fn run(
    rig: &RigConfig,
    bus: &Arc<dyn Bus>,
    options: &Options<'_>,
    progress: &mut dyn FnMut(Step<'_>),
) -> Result<Report, SelftestError> {
    if rig.devices.is_empty() {
        return Err(SelftestError::NoDevices);
    }
    let scratch;
    let folder = match &options.keep {
        Some(keep) => {
            std::fs::create_dir_all(keep)
                .map_err(|error| SelftestError::Keep(FileError::when("make the folder", keep)(error)))?;
            keep.as_path()
        }
        None => {
            scratch = Scratch::new().map_err(SelftestError::Scratch)?;
            scratch.path()
        }
    };
    let made_s = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
    let test = Test { rig, bus, options, folder };
    let findings = test.find(progress)?;
    let mut machine = MachineFacts::gather();
    machine.remove("host");
    Ok(Report {
        kind: Report::KIND.to_owned(),
        version: VERSION,
        program: concat!("erfgs ", env!("CARGO_PKG_VERSION")).to_owned(),
        made_utc: DateTime::of_seconds(made_s.cast_signed()).to_string(),
        machine,
        rig: rig.name.clone(),
        configuration: rig.text.clone(),
        seconds: options.length.as_secs_f64(),
        checks: judge(&findings),
        devices: findings.devices.iter().map(|entry| of_device(entry, &findings.together)).collect(),
    })
}

/// A test that runs.
struct Test<'a> {
    rig: &'a RigConfig,
    bus: &'a Arc<dyn Bus>,
    options: &'a Options<'a>,
    folder: &'a Path,
}

impl Test<'_> {
    fn find(&self, progress: &mut dyn FnMut(Step<'_>)) -> Result<Findings, SelftestError> {
        let mut devices = Vec::new();
        let mut opened = Vec::new();
        for device in &self.rig.devices {
            progress(Step::Opening { device: &device.id });
            let open = self.open(device);
            devices.push(DeviceFindings {
                device: device.clone(),
                opened: open.as_ref().map(|device| device.source.now()).map_err(Clone::clone),
                alone: Alone::Skipped("it was not recorded alone".into()),
                warnings: Vec::new(),
                readings: BTreeMap::new(),
            });
            opened.push(open.ok());
        }
        let several = opened.iter().flatten().count() > 1;
        for (entry, opened) in devices.iter_mut().zip(&opened) {
            let (Some(opened), Ok(description)) = (opened, &entry.opened) else { continue };
            entry.alone = match skipped(&entry.device, description, several) {
                Some(why) => Alone::Skipped(why.into()),
                None => self.alone(&entry.device.id, opened, progress)?,
            };
        }
        let together = self.together(&mut devices, &opened, progress)?;
        for (entry, opened) in devices.iter_mut().zip(&opened) {
            if let Some(opened) = opened {
                entry.warnings = opened.source.warnings();
                entry.opened = Ok(opened.source.now());
            }
        }
        Ok(Findings { devices, together })
    }

    /// Records all devices that start.
    fn together(
        &self,
        devices: &mut [DeviceFindings],
        opened: &[Option<Opened>],
        progress: &mut dyn FnMut(Step<'_>),
    ) -> Result<Together, SelftestError> {
        // A device that does not start alone would keep all others from starting.
        let starts = |entry: &DeviceFindings| !matches!(entry.alone, Alone::NotStarted(_));
        let (all, places): (Vec<&Opened>, Vec<usize>) = (opened.iter().zip(&*devices).enumerate())
            .filter_map(|(place, (opened, entry))| Some((opened.as_ref().filter(|_| starts(entry))?, place)))
            .unzip();
        if all.is_empty() {
            return Ok(Together::NotMade);
        }
        let path = self.folder.join("together.mcap");
        let made = record(self.rig, &all, &path, self.options.length, self.options.stop, &mut |share| {
            progress(Step::Recording { device: None, share });
        })?;
        Ok(match made {
            Outcome::Recorded(recording, readings) => {
                for (place, readings) in places.into_iter().zip(readings) {
                    devices[place].readings = readings;
                }
                Together::Recorded(recording)
            }
            Outcome::NotStarted { device, reason } => Together::NotStarted { device, reason },
        })
    }

    fn open(&self, device: &DeviceConfig) -> Result<Opened, String> {
        let alone = RigConfig { devices: vec![device.clone()], ..self.rig.clone() };
        let inputs = open_on(&alone, self.bus).map_err(|error| error.source.to_string())?;
        let Some(Input { source, queue_bytes, .. }) = inputs.into_iter().next() else {
            return Err("the rig names no such device".into());
        };
        Ok(Opened { source: SharedSource::new(source), queue_bytes })
    }

    fn alone(&self, id: &str, device: &Opened, progress: &mut dyn FnMut(Step<'_>)) -> Result<Alone, SelftestError> {
        let path = self.folder.join(format!("alone-{id}.mcap"));
        let mut of_device = |share| progress(Step::Recording { device: Some(id), share });
        let made = record(self.rig, &[device], &path, self.options.length, self.options.stop, &mut of_device)?;
        Ok(match made {
            Outcome::Recorded(recording, _) => Alone::Recorded(recording),
            Outcome::NotStarted { reason, .. } => Alone::NotStarted(reason),
        })
    }
}

/// Why a device is not recorded alone, if it is not.
fn skipped(device: &DeviceConfig, description: &Description, several: bool) -> Option<&'static str> {
    let setting = |name: &str| description.settings.get(name);
    let waits = description.is_triggered();
    match &device.settings {
        DeviceSettings::Trigger(_) => Some("a trigger board sends too little to be recorded alone"),
        _ if setting("sync").is_some_and(|role| role == "slave")
            || setting("clock_master").is_some_and(|is| is == false) =>
        {
            Some("its clock comes from another camera")
        }
        _ if !several && !waits => Some("it is the only device"),
        _ => None,
    }
}

fn of_device(entry: &DeviceFindings, together: &Together) -> DeviceReport {
    let id = &entry.device.id;
    let of = |recording| RecordedReport::of(recording, recording.stream(id)?).into();
    DeviceReport {
        id: id.clone(),
        description: entry.opened.as_ref().ok().cloned(),
        readings: entry.readings.clone(),
        alone: if let Alone::Recorded(recording) = &entry.alone { of(recording) } else { None },
        together: if let Together::Recorded(recording) = together { of(recording) } else { None },
    }
}
