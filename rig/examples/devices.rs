//! Lists the cameras and the serial ports that a rig can be made of. Opens none of them.
//!
//! usage: devices

use std::error::Error;

use erfgs_rig::{event, frame, trigger};

fn main() -> Result<(), Box<dyn Error>> {
    for camera in event::list()? {
        let state = camera.problem.unwrap_or_else(|| "ready".into());
        println!("event camera {} {} at {}: {state}", camera.model, camera.serial, camera.port);
    }
    for camera in frame::list()? {
        let state = camera.problem.unwrap_or_else(|| camera.formats.join(", "));
        println!("frame camera {} at {}: {state}", camera.name, camera.node.display());
    }
    for port in trigger::ports() {
        println!("serial port {port}, perhaps of a trigger board");
    }
    Ok(())
}
