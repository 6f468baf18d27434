//! Any bytes as the memory of a USB3 Vision camera: its registers, its manifest, its description. The camera is found and opened, or refused
//! with a reason; what its description tells of is read, set and run; and its stream is prepared.

mod camera;

use erfgs_rig::genicam::{
    Chunk, Features, GenicamConfig, GenicamError,
    u3v::{Device, find},
};

use self::camera::Camera;
use crate::memory;

/// Features that drivers ask for, and nodes of the seeds behind them.
const NAMES: [&str; 13] = [
    "Width",
    "WidthMax",
    "PixelFormat",
    "ExposureTime",
    "Gain",
    "GainRaw",
    "GammaEnable",
    "DeviceTemperature",
    "AcquisitionStart",
    "DeviceModelName",
    "ChunkFrameID",
    "Bits",
    "TriggerMode",
];
/// Bytes of a frame.
const FRAME: usize = 3072;

fn checked<T>(result: Result<T, GenicamError>) -> Option<T> {
    result.inspect_err(|error| assert!(!error.to_string().is_empty())).ok()
}

fn use_all(features: &mut Features) {
    features.attach(&[Chunk { id: 0x1003, data: &[1, 2, 3, 4, 5, 6, 7, 8] }]);
    for name in NAMES {
        let _ = (features.has(name), features.is_settable(name), features.choices(name), features.range(name));
        checked(features.number(name));
        checked(features.integer(name));
        checked(features.text(name));
        let _ = features.value(name);
        checked(features.set_number(name, 12.5));
        checked(features.set_flag(name, true));
        checked(features.set_text(name, "Mono8"));
        checked(features.run(name));
    }
    features.refresh();
}

/// Checks one input.
pub fn u3vcamera(input: &[u8]) {
    let bus = Camera::with(input);
    let peak = memory::peak(|| {
        let Ok(found) = find(&bus) else { panic!("the bus lists what is on it") };
        let [found] = &found[..] else { panic!("{found:?}") };
        for name in [&found.maker, &found.model, &found.serial, &found.name] {
            assert!(!name.chars().any(char::is_control), "{name:?}");
        }
        let Some(mut device) = checked(Device::open(&bus, found)) else { return };
        use_all(&mut device.features);
        if let Some(intake) = checked(device.prepare(&GenicamConfig::default(), FRAME)) {
            let [leader, transfer, count, first, second, trailer] = intake.sizes.told.map(|size| size as usize);
            assert!(transfer * count + first + second >= FRAME.min(intake.sizes.block_bytes));
            assert!([leader, first, second, trailer].iter().all(|&size| size <= transfer));
        }
    });
    // An archive of some kilobytes may hold megabytes.
    let limit = (96 << 20) + 1024 * input.len();
    assert!(peak <= limit, "{peak} bytes of memory for a camera of {} bytes", input.len());
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_seeds_are_cameras() {
        let (whole, parts) = crate::seeds("u3vcamera").split_at(2);
        assert_eq!(parts.len(), 5);
        for seed in parts {
            let bus = Camera::with(seed);
            let device = Device::open(&bus, &find(&bus).unwrap()[0]).unwrap();
            assert!(NAMES.into_iter().any(|name| device.features.value(name).is_some()));
        }
        for seed in whole {
            let bus = Camera::with(seed);
            let found = find(&bus).unwrap().remove(0);
            assert_eq!([found.label(), found.serial.clone(), found.name.clone()], ["Maker Model", "0042", "left"]);
            let mut device = Device::open(&bus, &found).unwrap();
            let features = &mut device.features;
            features.attach(&[Chunk { id: 0x1003, data: &[5, 0, 0, 0, 0, 0, 0, 0] }]);
            let numbers = ["Width", "WidthMax", "ExposureTime", "Gain", "GainRaw", "DeviceTemperature", "ChunkFrameID"];
            let numbers = numbers.map(|name| features.number(name).unwrap());
            assert_eq!(numbers, [64.0, 640.0, 2000.0, 199.9, 1999.0, 20.0, 5.0]);
            assert_eq!((features.text("PixelFormat").unwrap().as_str(), features.has("TriggerMode")), ("Mono8", true));
            features.set_number("ExposureTime", 3000.0).unwrap();
            assert_eq!(features.number("ExposureTime").unwrap(), 3000.0);
            assert!(device.prepare(&GenicamConfig::default(), FRAME).is_ok());
        }
    }
}
