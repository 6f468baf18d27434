//! `erfgs devices`: what is connected that a rig can be made of.

use erfgs_rig::event::{self, FoundDevice};
use serde::Serialize;

use crate::terminal::{Terminal, table};

/// List the cameras and boards that a rig can be made of.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  erfgs devices
  erfgs devices --json | jq '.event_cameras[].serial'

The serial numbers and ports are what RIG.toml chooses devices by (`erfgs record --example`). A device with a problem is
listed with what to do about it.")]
pub struct Arguments {}

#[derive(Serialize)]
struct Devices {
    event_cameras: Vec<FoundDevice>,
    /// Why a kind of device could not be looked for.
    problems: Vec<String>,
}

/// Lists devices.
pub fn run(_: &Arguments, terminal: &Terminal) -> anyhow::Result<()> {
    let mut problems = Vec::new();
    let event_cameras = event::list().unwrap_or_else(|error| {
        problems.push(format!("event cameras cannot be looked for: {error}"));
        Vec::new()
    });
    let devices = Devices { event_cameras, problems };
    terminal.result(&devices, || text(&devices))
}

fn text(devices: &Devices) -> String {
    let mut rows = vec![["kind", "model", "serial", "port", "link"].map(String::from).to_vec()];
    let mut remarks = devices.problems.clone();
    for camera in &devices.event_cameras {
        let kind = serde_json::to_value(camera.kind).ok();
        let kind = kind.as_ref().and_then(serde_json::Value::as_str).unwrap_or("unknown").to_owned();
        rows.push(vec![kind, camera.model.clone(), camera.serial.clone(), camera.port.clone(), camera.link.clone()]);
        remarks
            .extend(camera.problem.as_ref().map(|problem| format!("{} at {}: {problem}", camera.model, camera.port)));
    }
    let list = if rows.len() > 1 { table(&rows) } else { "no devices found\n".to_owned() };
    remarks.into_iter().fold(list, |text, remark| format!("{text}{remark}\n"))
}
