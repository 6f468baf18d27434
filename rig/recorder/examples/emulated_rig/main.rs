//! A rig without hardware: two emulated EVK4 and a DAVIS346 film a small stage through the real USB drivers, four frame
//! cameras beside them; everything is recorded and shown on the live page.
//!
//! ```text
//! cargo run --release -p erfgs-recorder --example emulated_rig -- OUT.mcap [SECONDS] [ADDRESS]
//! ```
//!
//! The frame cameras are not behind a driver (a UVC driver needs a kernel): they hand the stage's pictures to the
//! recorder as MJPEG frames, and their model says so.

#[path = "../../../tests/it/usb_cameras/support/bus.rs"]
mod bus;
mod camera;

use std::{
    env,
    error::Error,
    path::{Path, PathBuf},
    sync::{Arc, Mutex},
    thread,
    time::{Duration, Instant},
};

use bus::{Clock, EmulatedBus};
use camera::StageCamera;
use erfgs_hardware_mocks::usb::{
    Davis346, Davis346Options, Evk4, Evk4Options, UsbDevice,
    evk4::Stimulus,
    scene::{TakeEvents, TakeFrames},
};
use erfgs_recorder::{
    Input, MachineFacts, Options, Recorder, RigConfig, SessionFiles, SessionInfo, folder_of,
    live::{LivePage, Monitor, MonitorOptions, PageOptions},
    open_on,
};
use erfgs_rig::{host_time::host_ns, usb::Bus};
use erfgs_stage::{EventOptions, RigOptions, Stage, StageOptions, StageView};

const RIG: &str = r#"
[rig]
name = "emulated-stage"

[[evk4]]
id = "event-left"
serial = "00050101"

[[evk4]]
id = "event-right"
serial = "00050102"

[[davis346]]
id = "davis"
frames = { interval_us = 100000, exposure_us = 4000 }
"#;

struct HostClock;

impl Clock for HostClock {
    fn now_ns(&self) -> i64 {
        host_ns()
    }

    fn pass(&self, duration: Duration) {
        thread::sleep(duration);
    }
}

/// Length of the take that plays again and again.
const TAKE_US: u64 = 300_000;
/// Frames of the frame cameras' take, and their size.
const FRAMES: usize = 9;
const FRAME_SIZE: (u32, u32) = (640, 400);

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = env::args().skip(1);
    let out = PathBuf::from(arguments.next().ok_or("usage: emulated_rig OUT.mcap [SECONDS] [ADDRESS]")?);
    let seconds: f64 = arguments.next().map_or(Ok(20.0), |text| text.parse())?;
    let address = arguments.next().unwrap_or_else(|| "127.0.0.1:8100".into()).parse()?;

    eprintln!("filming the stage");
    let rig = RigConfig::parse(RIG, Path::new("emulated rig"))?;
    let bus = EmulatedBus::new(Arc::new(HostClock));
    devices()?.into_iter().for_each(|device| bus.add(Arc::new(Mutex::new(device))));
    let bus: Arc<dyn Bus> = Arc::new(bus);
    let mut inputs = open_on(&rig, &bus)?;
    for index in 0..4 {
        let source = Box::new(StageCamera::film(&format!("rgb-{}", index + 1), index, FRAMES, FRAME_SIZE)?);
        inputs.push(Input { source, queue_bytes: 64 << 20, stall_after: Some(Duration::from_secs(2)) });
    }
    let descriptions: Vec<_> = inputs.iter().map(|input| input.source.description().clone()).collect();
    let monitor = Monitor::new(&descriptions, MonitorOptions::default())?;
    let options = Options {
        info: SessionInfo {
            rig: rig.name.clone(),
            replay: false,
            configuration: rig.text.clone(),
            program: "emulated_rig".into(),
            machine: MachineFacts::gather(),
            warnings: Vec::new(),
        },
        flush_every: Duration::from_millis(500),
        reserve_bytes: 512 << 20,
        folder: folder_of(&out),
        opener: Box::new(SessionFiles::default()),
        subscriber: Some(Arc::clone(&monitor) as _),
    };
    let recorder = Arc::new(Recorder::new(inputs, options)?);
    let page =
        LivePage::serve(Arc::clone(&recorder), monitor, &PageOptions { address, names: Vec::new(), open: true })?;
    eprintln!("live page: {}", page.url());
    recorder.start_recording(&out)?;
    recorder.start_sources()?;
    let begun = Instant::now();
    while begun.elapsed().as_secs_f64() < seconds {
        thread::sleep(Duration::from_millis(100));
    }
    recorder.stop_sources();
    if let Ok(summary) = recorder.stop_recording("the time was over") {
        println!("{}", serde_json::to_string_pretty(&summary)?);
    }
    Ok(())
}

/// Two EVK4 and a DAVIS346 that look at the stage from different places.
fn devices() -> Result<Vec<Box<dyn UsbDevice>>, Box<dyn Error>> {
    let stage = Stage::new(StageOptions { samples_per_axis: 1, ..StageOptions::default() });
    let events = |number: usize, width: u32, height: u32| -> Result<TakeEvents, Box<dyn Error>> {
        let cameras = RigOptions { width, height, rgb: 0, event: 3, test: 0, ..RigOptions::default() }.cameras(1)?;
        let view = StageView::new(&stage, &cameras[number].intrinsics, &cameras[number].world_to_camera)?;
        // Dull sensors: the models make their events while they are recorded, on the same machine.
        let dull = EventOptions { threshold_on: 0.4, threshold_off: 0.4, ..EventOptions::default() };
        Ok(TakeEvents::record(&view, TAKE_US, &dull, number as u64)?)
    };
    let frames = {
        let rig = RigOptions { width: 346, height: 260, rgb: 0, event: 3, test: 0, ..RigOptions::default() };
        let camera = rig.cameras(1)?.swap_remove(1);
        let view = StageView::new(&stage, &camera.intrinsics, &camera.world_to_camera)?;
        TakeFrames::film(&view, 3, TAKE_US as i64 * 1000 / 3, 4_000_000)
    };
    let evk4 =
        |serial, events| Evk4::new(Evk4Options { serial, ..Default::default() }, Stimulus::Scene(Box::new(events)));
    Ok(vec![
        Box::new(evk4(0x0005_0101, events(0, 1280, 720)?)),
        Box::new(evk4(0x0005_0102, events(2, 1280, 720)?)),
        Box::new(Davis346::new(Davis346Options::default(), Box::new(events(1, 346, 260)?), Box::new(frames))),
    ])
}
