//! `erfgs devices`: what is connected that a rig can be made of, and whether a rig works.

mod selftest;

use std::net::Ipv4Addr;

use erfgs_rig::{
    event::{self, FoundDevice},
    frame::{self, FoundCamera},
    trigger,
};
use serde::Serialize;

use crate::terminal::{Terminal, table};

/// List the cameras and boards that a rig can be made of, or test a rig.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  erfgs devices
  erfgs devices --probe
  erfgs devices --at 10.0.3.7
  erfgs devices --json | jq '.event_cameras[].serial'
  erfgs devices --selftest RIG.toml                             a verdict a line, and selftest-DATE-TIME.json
  erfgs devices --selftest RIG.toml --seconds 20 --out left.json
  erfgs devices --selftest RIG.toml --json | jq -r '.checks[] | select(.verdict == \"fault\") | .found'

RIG.toml selects devices by these serial numbers and ports (`erfgs record --example`). A device with a problem is listed with \
its remedy.

The self-test opens each device, records it alone and with all others, and checks what no data sheet says of your rig: serial \
numbers, words, clocks, losses, rates, buses, and whether pulses, frames and strobes belong together. The report is one file to \
pass on; it holds settings and registers, and no pictures (--keep keeps the recordings). docs/reference/selftest.md lists the checks.

Exit codes: 0 listed, or no fault found; 1 a fault; 2 wrong usage; 130 stopped by Ctrl-C.")]
pub struct Arguments {
    /// Ask at the serial ports for trigger boards. Opening a port restarts an Arduino.
    #[arg(long)]
    probe: bool,
    /// Ask this address for a GigE Vision camera, too: broadcasts do not pass routers. May be given several times.
    #[arg(long, value_name = "ADDRESS")]
    at: Vec<Ipv4Addr>,
    #[command(flatten)]
    test: selftest::Arguments,
}

#[derive(Serialize)]
struct Devices {
    event_cameras: Vec<FoundDevice>,
    cameras: Vec<FoundCamera>,
    /// Serial ports at which a trigger board may be.
    ports: Vec<Port>,
    /// Why a kind of device could not be looked for.
    problems: Vec<String>,
}

#[derive(Serialize)]
struct Port {
    port: String,
    /// What answered there, where it was asked.
    answer: Option<String>,
}

/// Lists devices, or tests a rig of them.
pub fn run(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<()> {
    if let Some(rig) = &arguments.test.selftest {
        return selftest::run(rig, &arguments.test, terminal);
    }
    let mut problems = Vec::new();
    let event_cameras = event::list().unwrap_or_else(|error| {
        problems.push(format!("cannot search for event cameras: {error}"));
        Vec::new()
    });
    let mut cameras = frame::list().unwrap_or_else(|error| {
        problems.push(format!("cannot search for cameras: {error}"));
        Vec::new()
    });
    for (kind, found) in [("GigE", gige(&arguments.at)), ("USB3", u3v())] {
        match found {
            Ok(found) => cameras.extend(found),
            Err(error) => problems.push(format!("cannot search for {kind} Vision cameras: {error}")),
        }
    }
    let ports = trigger::ports();
    let ports = if arguments.probe {
        let probed = trigger::find(&ports).into_iter().map(|(port, found)| {
            let answer = match found {
                Ok(board) => format!("trigger board, firmware {}", board.identity.firmware),
                Err(error) => error.to_string(),
            };
            Port { port, answer: Some(answer) }
        });
        probed.collect()
    } else {
        ports.into_iter().map(|port| Port { port, answer: None }).collect()
    };
    let devices = Devices { event_cameras, cameras, ports, problems };
    terminal.result(&devices, || text(&devices))
}

#[cfg(target_os = "linux")]
fn gige(addresses: &[Ipv4Addr]) -> Result<Vec<FoundCamera>, String> {
    frame::list_gige(addresses).map_err(|error| error.to_string())
}

#[cfg(target_os = "linux")]
fn u3v() -> Result<Vec<FoundCamera>, String> {
    frame::list_u3v().map_err(|error| error.to_string())
}

/// On other systems there is no driver of them.
#[cfg(not(target_os = "linux"))]
fn u3v() -> Result<Vec<FoundCamera>, String> {
    Ok(Vec::new())
}

/// On other systems there is no driver of them.
#[cfg(not(target_os = "linux"))]
fn gige(addresses: &[Ipv4Addr]) -> Result<Vec<FoundCamera>, String> {
    if addresses.is_empty() { Ok(Vec::new()) } else { Err("their driver exists on Linux alone".into()) }
}

fn text(devices: &Devices) -> String {
    let mut rows = vec![["kind", "model", "serial", "port", "link or formats"].map(String::from).to_vec()];
    let mut remarks = devices.problems.clone();
    for camera in &devices.event_cameras {
        let kind = serde_json::to_value(camera.kind).ok();
        let kind = kind.as_ref().and_then(serde_json::Value::as_str).unwrap_or("unknown").to_owned();
        rows.push(vec![kind, camera.model.clone(), camera.serial.clone(), camera.port.clone(), camera.link.clone()]);
        remarks
            .extend(camera.problem.as_ref().map(|problem| format!("{} at {}: {problem}", camera.model, camera.port)));
    }
    for camera in &devices.cameras {
        // What a machine-vision camera offers is known when it is opened.
        let link = match camera.driver.as_str() {
            "gige" => "GigE Vision".into(),
            "u3v" => format!("USB3 Vision, {}", camera.link.as_deref().unwrap_or("unknown speed")),
            _ => camera.formats.join(" "),
        };
        rows.push(vec!["camera".into(), camera.name.clone(), camera.serial.clone(), camera.bus.clone(), link]);
        remarks.extend(camera.problem.as_ref().map(|problem| format!("{} at {}: {problem}", camera.name, camera.bus)));
    }
    for port in &devices.ports {
        let model = port.answer.clone().unwrap_or_else(|| "serial port, not asked (--probe)".into());
        rows.push(vec!["trigger".into(), model, String::new(), port.port.clone(), String::new()]);
    }
    let list = if rows.len() > 1 { table(&rows) } else { "no devices found\n".to_owned() };
    remarks.into_iter().fold(list, |text, remark| format!("{text}{remark}\n"))
}
