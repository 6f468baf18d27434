//! A rig without hardware: two emulated EVK4 and a DAVIS346 film a small stage through the real USB drivers, four frame
//! cameras beside them; everything is recorded and shown on the live page.
//!
//! ```text
//! cargo run --release -p erfgs-recorder --example emulated_rig -- OUT.mcap [SECONDS] [ADDRESS]
//! ```
//!
//! Filming the stage takes minutes the first time, and says how far it is; the films are kept in the user's cache (or the
//! folder that `ERFGS_FILMS` names), and the next start takes a second.
//!
//! The frame cameras are not behind a driver (a UVC driver needs a kernel): they hand the stage's pictures to the
//! recorder as MJPEG frames, and their model says so.

#[path = "../../../tests/it/usb_cameras/support/bus.rs"]
mod bus;
mod camera;
mod film;
#[path = "../../../tests/it/usb_cameras/support/host_clock.rs"]
mod host_clock;

use std::{
    env,
    error::Error,
    path::{Path, PathBuf},
    sync::{Arc, Mutex},
    thread,
    time::{Duration, Instant},
};

use bus::EmulatedBus;
use camera::{RATE_HZ, StageCamera};
use erfgs_hardware_mocks::usb::{
    Davis346, Davis346Options, Evk4, Evk4Options, UsbDevice,
    evk4::Stimulus,
    scene::{Picture, TakeEvents, TakeFrames},
};
use erfgs_recorder::{
    Input, MachineFacts, Options, Recorder, RigConfig, SessionFiles, SessionInfo, folder_of,
    live::{LivePage, Monitor, MonitorOptions, PageOptions},
    open_on,
};
use erfgs_rig::usb::Bus;
use erfgs_stage::EventOptions;
use film::{Films, Place};
use host_clock::HostClock;

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

/// Length of the take that plays again and again.
const TAKE_US: u64 = 300_000;
/// Frames of the frame cameras' take, and their size.
const FRAMES: usize = 9;
const FRAME_SIZE: [u32; 2] = [640, 400];

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = env::args().skip(1);
    let out = PathBuf::from(arguments.next().ok_or("usage: emulated_rig OUT.mcap [SECONDS] [ADDRESS]")?);
    let seconds: f64 = arguments.next().map_or(Ok(20.0), |text| text.parse())?;
    let address = arguments.next().unwrap_or_else(|| "127.0.0.1:8100".into()).parse()?;

    let films = Films::open()?;
    let rig = RigConfig::parse(RIG, Path::new("emulated rig"))?;
    let bus = EmulatedBus::new(Arc::new(HostClock));
    devices(&films)?.into_iter().for_each(|device| bus.add(Arc::new(Mutex::new(device))));
    let bus: Arc<dyn Bus> = Arc::new(bus);
    let mut inputs = open_on(&rig, &bus)?;
    for (index, name) in ["rgb-1", "rgb-2", "rgb-3", "rgb-4"].into_iter().enumerate() {
        let place = Place { name, rig: [4, 0], index, size: FRAME_SIZE };
        let frames = films.pictures(&place, FRAMES, 1_000_000_000 / RATE_HZ, 8_000_000)?;
        let source = Box::new(StageCamera::new(name, frames, FRAME_SIZE));
        inputs.push(Input { source, queue_bytes: 64 << 20, stall_after: Some(Duration::from_secs(2)) });
    }
    eprintln!("the stage is on film in '{}'", films.folder().display());
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
            begin_host_ns: None,
        },
        flush_every: Duration::from_millis(500),
        reserve_bytes: 512 << 20,
        folder: folder_of(&out),
        opener: Box::new(SessionFiles::default()),
        subscriber: Some(Arc::clone(&monitor) as _),
        before: None,
        after: None,
        rig_file: None,
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
fn devices(films: &Films) -> Result<Vec<Box<dyn UsbDevice>>, Box<dyn Error>> {
    let place = |name, index, size| Place { name, rig: [0, 3], index, size };
    let davis = place("davis", 1, [346, 260]);
    let events = |place: Place| -> Result<TakeEvents, Box<dyn Error>> {
        // Dull sensors: the models make their events while they are recorded, on the same machine.
        let dull = EventOptions { threshold_on: 0.4, threshold_off: 0.4, ..EventOptions::default() };
        Ok(TakeEvents::new(films.events(&place, TAKE_US, &dull, place.index as u64)?, TAKE_US))
    };
    let period_ns = TAKE_US as i64 * 1000 / 3;
    let mut pictures = Vec::new();
    for jpeg in films.pictures(&Place { name: "davis-frames", ..davis }, 3, period_ns, 4_000_000)? {
        let image = image::load_from_memory(&jpeg)?.to_rgb8();
        pictures.push(Arc::new(Picture { width: image.width(), height: image.height(), rgb: image.into_raw() }));
    }
    let frames = TakeFrames::new(pictures, period_ns);
    let evk4 =
        |serial, events| Evk4::new(Evk4Options { serial, ..Default::default() }, Stimulus::Scene(Box::new(events)));
    let left = events(place("event-left", 0, [1280, 720]))?;
    let right = events(place("event-right", 2, [1280, 720]))?;
    Ok(vec![
        Box::new(evk4(0x0005_0101, left)),
        Box::new(evk4(0x0005_0102, right)),
        Box::new(Davis346::new(Davis346Options::default(), Box::new(events(davis)?), Box::new(frames))),
    ])
}
