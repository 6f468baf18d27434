//! The USB topology from `/sys/bus/usb`: which devices share which bus, at what speed, and what they send together.

use erfgs_session::source::Description;
use std::{collections::BTreeMap, fs, path::Path};

use super::{Finding, rates::rates_of};

/// Share of a bus' nominal rate that payload can take.
const PAYLOAD: f64 = 0.8;

const SPREAD: &str = "plug cameras into ports of other USB controllers (`lsusb -t` shows which ports share one), or \
                      lower their rates";
const SLOW_LINK: &str = "use a USB 3 port and a USB 3 cable, directly into the computer";

/// A device on the bus.
#[derive(Clone, Debug, PartialEq)]
struct Device {
    /// Directory name: `2-1.4`.
    name: String,
    serial: String,
    bus: String,
    mbit: f64,
}

fn devices(root: &Path) -> Vec<Device> {
    let Ok(entries) = fs::read_dir(root.join("sys/bus/usb/devices")) else { return Vec::new() };
    let device = |entry: fs::DirEntry| {
        let read = |name: &str| fs::read_to_string(entry.path().join(name)).ok().map(|text| text.trim().to_owned());
        Some(Device {
            name: entry.file_name().into_string().ok()?,
            serial: read("serial").unwrap_or_default(),
            bus: read("busnum")?,
            mbit: read("speed")?.parse().ok()?,
        })
    };
    entries.filter_map(|entry| device(entry.ok()?)).collect()
}

/// The device that a stream comes from: by serial number, or by the port that its driver names in the settings.
fn device_of<'a>(devices: &'a [Device], stream: &Description) -> Option<&'a Device> {
    let port = ["usb_port", "port", "bus_path"].iter().find_map(|name| stream.settings.get(*name)?.as_str());
    devices
        .iter()
        .filter(|device| !device.name.starts_with("usb"))
        .find(|device| port == Some(&device.name) || (!stream.serial.is_empty() && device.serial == stream.serial))
}

pub(super) fn check(streams: &[Description], root: &Path) -> Vec<Finding> {
    const CHECK: &str = "usb";
    let devices = devices(root);
    let mut findings = Vec::new();
    let mut buses: BTreeMap<&str, (f64, f64, Vec<&str>)> = BTreeMap::new();
    for stream in streams {
        let Some(device) = device_of(&devices, stream) else { continue };
        let rates = rates_of(stream);
        let link = device.mbit * 1e6 / 8.0 * PAYLOAD;
        let says = format!(
            "'{}' at {} is linked at {} Mbit/s, about {:.0} MB/s; it sends up to {:.0} MB/s",
            stream.id,
            device.name,
            device.mbit,
            link / 1e6,
            rates.peak / 1e6
        );
        if rates.steady > link {
            findings.push(Finding::refusal(CHECK, says, SLOW_LINK));
        } else if rates.peak > link {
            findings.push(Finding::warning(CHECK, says, SLOW_LINK));
        }
        let root_hub = devices.iter().find(|hub| hub.name == format!("usb{}", device.bus));
        let capacity = root_hub.map_or(device.mbit, |hub| hub.mbit) * 1e6 / 8.0 * PAYLOAD;
        let (_, load, ids) = buses.entry(&device.bus).or_insert((capacity, 0.0, Vec::new()));
        *load += rates.peak;
        ids.push(&stream.id);
    }
    for (bus, (capacity, load, ids)) in buses {
        let says = format!(
            "bus {bus} carries about {:.0} MB/s; {} can send {:.0} MB/s together",
            capacity / 1e6,
            ids.join(", "),
            load / 1e6
        );
        findings.push(if load > capacity { Finding::warning(CHECK, says, SPREAD) } else { Finding::good(CHECK, says) });
    }
    findings
}

#[cfg(test)]
mod tests {
    use erfgs_events::EventEncoding;
    use erfgs_scene::pixel::PixelFormat;
    use erfgs_session::source::Encoding;

    use super::{super::Verdict, *};

    fn lay_out(root: &Path, name: &str, serial: &str, bus: &str, mbit: &str) {
        let folder = root.join("sys/bus/usb/devices").join(name);
        fs::create_dir_all(&folder).unwrap();
        for (file, text) in [("serial", serial), ("busnum", bus), ("speed", mbit)] {
            fs::write(folder.join(file), format!("{text}\n")).unwrap();
        }
    }

    fn camera(id: &str, serial: &str, encoding: Encoding) -> Description {
        let (model, settings) = (String::new(), serde_json::Map::new());
        let (id, serial, start_order) = (id.into(), serial.into(), 0);
        Description { id, model, serial, encoding, width: 1920, height: 1080, start_order, settings }
    }

    #[test]
    fn slow_links_and_crowded_buses_are_told() {
        let root = tempfile::tempdir().unwrap();
        lay_out(root.path(), "usb1", "", "1", "480");
        lay_out(root.path(), "usb2", "", "2", "5000");
        lay_out(root.path(), "1-1", "slow", "1", "480");
        for port in 1..=5 {
            lay_out(root.path(), &format!("2-{port}"), &format!("fast{port}"), "2", "5000");
        }
        let verdicts = |streams: &[Description]| -> Vec<Verdict> {
            check(streams, root.path()).iter().map(|finding| finding.verdict).collect()
        };
        let fast = |port| camera(&format!("f{port}"), &format!("fast{port}"), Encoding::Events(EventEncoding::Evt3));
        assert_eq!(
            verdicts(&[camera("s", "slow", Encoding::Events(EventEncoding::Evt3))]),
            [Verdict::Warning, Verdict::Warning]
        );
        assert_eq!(
            verdicts(&[camera("s", "slow", Encoding::Frames(PixelFormat::Yuyv))]),
            [Verdict::Refusal, Verdict::Warning]
        );
        assert_eq!(verdicts(&[fast(1), fast(2)]), [Verdict::Good]);
        assert_eq!(verdicts(&[1, 2, 3, 4, 5].map(fast)), [Verdict::Warning]);
        assert_eq!(verdicts(&[camera("x", "elsewhere", Encoding::Events(EventEncoding::Evt3))]), []);
    }

    #[test]
    fn without_a_system_folder_nothing_is_claimed() {
        assert_eq!(check(&[camera("x", "1", Encoding::Events(EventEncoding::Evt3))], Path::new("/nonexistent")), []);
    }
}
