use std::{
    fs,
    path::{Path, PathBuf},
};

use super::sys::{Capabilities, Node};
use crate::frame::{FoundCamera, FrameError};

/// The cameras of this machine.
pub fn list() -> Result<Vec<FoundCamera>, FrameError> {
    list_in(Path::new("/dev"), Path::new("/sys/class/video4linux"))
}

/// The cameras whose nodes lie in one folder, described in another (`/dev`, `/sys/class/video4linux`).
///
/// # Errors
/// If the folder of nodes cannot be read.
pub fn list_in(nodes: &Path, class: &Path) -> Result<Vec<FoundCamera>, FrameError> {
    let entries = fs::read_dir(nodes)
        .map_err(|error| FrameError::List { reason: format!("cannot read {}: {error}", nodes.display()) })?;
    let mut numbered: Vec<(u32, PathBuf)> = entries
        .filter_map(Result::ok)
        .filter_map(|entry| {
            let number = entry.file_name().to_str()?.strip_prefix("video")?.parse().ok()?;
            Some((number, entry.path()))
        })
        .collect();
    numbered.sort_unstable();
    Ok(numbered.into_iter().filter_map(|(_, node)| look_at(&node, class)).collect())
}

/// What a node is; `None` if it gives no frames.
fn look_at(path: &Path, class: &Path) -> Option<FoundCamera> {
    let camera = |capabilities: Option<Capabilities>, formats, problem| {
        let described = |what| text_file(&class.join(path.file_name().unwrap_or_default()).join(what));
        FoundCamera {
            name: capabilities.as_ref().map_or_else(|| described("name"), |c| c.card.clone()),
            serial: serial(path, class),
            bus: capabilities.as_ref().map_or_else(String::new, |c| c.bus.clone()),
            node: path.to_owned(),
            driver: capabilities.map_or_else(String::new, |c| c.driver),
            formats,
            link: None,
            problem,
        }
    };
    let opened = Node::open(path).and_then(|node| node.capabilities().map(|capabilities| (node, capabilities)));
    match opened {
        Ok((_, capabilities)) if !capabilities.captures() => None,
        Ok((node, capabilities)) => {
            let formats = node.formats().into_iter().map(fourcc_text).collect();
            Some(camera(Some(capabilities), formats, None))
        }
        Err(error) => {
            let problem = format!("cannot be opened: {error}. Are you in the group that may use it (video)?");
            Some(camera(None, Vec::new(), Some(problem)))
        }
    }
}

/// A four-character code as text.
pub fn fourcc_text(fourcc: u32) -> String {
    String::from_utf8_lossy(&fourcc.to_le_bytes()).trim_end().to_owned()
}

fn text_file(path: &Path) -> String {
    fs::read_to_string(path).map(|text| text.trim().to_owned()).unwrap_or_default()
}

/// The serial number of the USB device that a node's interface belongs to.
fn serial(node: &Path, class: &Path) -> String {
    let interface = class.join(node.file_name().unwrap_or_default()).join("device");
    match fs::canonicalize(interface) {
        Ok(interface) => interface.parent().map(|device| text_file(&device.join("serial"))).unwrap_or_default(),
        Err(_) => String::new(),
    }
}

/// The camera that a configuration means: by serial number, place, node or name, in this order.
pub fn choose(id: &str, wanted: &str, cameras: Vec<FoundCamera>) -> Result<FoundCamera, FrameError> {
    let describe = |camera: &FoundCamera| {
        let serial = if camera.serial.is_empty() { String::new() } else { format!(", serial {}", camera.serial) };
        format!("{} ({}, at {}{serial})", camera.name, camera.node.display(), camera.bus)
    };
    let found = match cameras.as_slice() {
        [] => "none".to_owned(),
        cameras => cameras.iter().map(describe).collect::<Vec<_>>().join("; "),
    };
    let fail = |problem: String| FrameError::Find { id: id.to_owned(), problem, found: found.clone() };
    let kinds: [fn(&FoundCamera) -> String; 4] =
        [|c| c.serial.clone(), |c| c.bus.clone(), |c| c.node.display().to_string(), |c| c.name.clone()];
    for kind in kinds {
        let mut matching = cameras.iter().filter(|camera| wanted.is_empty() || kind(camera) == wanted);
        match (matching.next(), matching.next()) {
            (Some(camera), None) => return Ok(camera.clone()),
            (Some(_), Some(_)) if wanted.is_empty() => {
                return Err(fail("several are plugged in; name one as `camera`".into()));
            }
            (Some(_), Some(_)) => return Err(fail(format!("several are {wanted:?}; name one by its place"))),
            (None, _) => {}
        }
    }
    Err(fail(if wanted.is_empty() { "none is plugged in".into() } else { format!("none is {wanted:?}") }))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(number: u32, serial: &str, bus: &str) -> FoundCamera {
        FoundCamera {
            name: "Webcam".into(),
            serial: serial.into(),
            bus: bus.into(),
            node: format!("/dev/video{number}").into(),
            driver: "uvcvideo".into(),
            formats: Vec::new(),
            link: None,
            problem: None,
        }
    }

    #[test]
    fn a_camera_is_meant_by_serial_place_node_or_name() {
        let both = || vec![camera(0, "A1", "usb-1"), camera(2, "B2", "usb-2")];
        for (wanted, node) in [("A1", "/dev/video0"), ("usb-2", "/dev/video2"), ("/dev/video0", "/dev/video0")] {
            assert_eq!(choose("x", wanted, both()).unwrap().node, PathBuf::from(node));
        }
        let ambiguous = choose("x", "Webcam", both()).unwrap_err().to_string();
        assert!(ambiguous.contains("several are \"Webcam\"") && ambiguous.contains("serial B2"), "{ambiguous}");
        assert!(choose("x", "", both()).unwrap_err().to_string().contains("several are plugged in"));
        assert!(choose("x", "C3", both()).unwrap_err().to_string().contains("none is \"C3\""));
        assert_eq!(choose("x", "", vec![camera(0, "", "usb-1")]).unwrap().bus, "usb-1");
        assert!(choose("x", "", Vec::new()).unwrap_err().to_string().contains("plugged in are: none"));
    }
}
