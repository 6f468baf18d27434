//! Which bus a device shares with others.

use erfgs_session::source::Description;

/// The bus of a device, as its driver tells it: `USB bus 2`, `the network`; `None` where it does not.
pub fn of(description: &Description) -> Option<String> {
    let text = |name: &str| description.settings.get(name)?.as_str();
    if text("backend") == Some("gige") {
        return Some("the network".to_owned());
    }
    // `04b4:00f5 at 2:5 (port 2-1.3)`, or the kernel's `usb-0000:00:14.0-2`.
    let device = description.settings.get("usb").and_then(|usb| usb.get("device")?.as_str());
    let of_device = device.and_then(|device| Some(device.split_once(" at ")?.1.split_once(':')?.0));
    let of_path = text("bus");
    let of_path = of_path.map(|path| path.rsplit_once('-').map_or(path, |(controller, _)| controller));
    of_device.or(of_path).map(|bus| format!("USB bus {bus}"))
}

#[cfg(test)]
mod tests {
    use erfgs_session::source::Encoding;
    use serde_json::json;

    use super::*;

    #[test]
    fn a_bus_is_known_by_what_drivers_tell() {
        let on = |settings: serde_json::Value| {
            let settings = settings.as_object().cloned().unwrap_or_default();
            let description = Description::trigger_board("a", settings);
            assert_eq!(description.encoding, Encoding::TriggerLines);
            of(&description)
        };
        let usb = json!({ "usb": { "device": "04b4:00f5 at 2:5 (port 2-1.3)", "link": "5 Gbit/s" } });
        assert_eq!(on(usb).as_deref(), Some("USB bus 2"));
        let path = json!({ "backend": "v4l2", "bus": "usb-0000:00:14.0-2" });
        assert_eq!(on(path).as_deref(), Some("USB bus usb-0000:00:14.0"));
        assert_eq!(on(json!({ "backend": "gige", "address": "10.0.0.2" })).as_deref(), Some("the network"));
        assert_eq!(on(json!({ "port": "/dev/ttyACM0", "usb": 7 })), None);
    }
}
