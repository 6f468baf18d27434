//! `erfgs-usbd`: serves a rig of emulated USB devices to this machine's kernel, or to the umockdev bridge.

use std::{
    collections::BTreeMap,
    error::Error,
    fs::{self, File, OpenOptions},
    io::{BufRead as _, Write as _},
    os::unix::net::{UnixListener, UnixStream},
    path::{Path, PathBuf},
    process::ExitCode,
    sync::mpsc,
    time::Duration,
};

use clap::Parser;
use erfgs_hardware_mocks::usb::{
    SharedCounts, TriggerLine, UsbDevice as _,
    faults::SharedLedger,
    front::{monotonic_ns, usbip::Server, vhci},
    rigfile::{BuiltDevice, RigFile},
};

/// Serves emulated USB devices until it is told to stop. Commands come on the standard input, a line each:
///
///   unplug NAME          pull a device out
///   plug NAME            plug it in again, freshly powered
///   trigger NS 0|1       an edge on the trigger lines, at a time of CLOCK_MONOTONIC
///   quit                 stop (the end of the input does not stop it)
#[derive(Parser)]
#[command(version, verbatim_doc_comment)]
struct Cli {
    /// The rig (TOML).
    rig: PathBuf,
    /// Serve through sockets NAME.sock in this folder, instead of plugging into the kernel.
    #[arg(long, value_name = "FOLDER")]
    sockets: Option<PathBuf>,
    /// Where to write, at the end, what was delivered and counted (JSON).
    #[arg(long, value_name = "FILE")]
    ledger: Option<PathBuf>,
    /// Copy every byte that is delivered to NAME-SESSION-ENDPOINT.bin in this folder.
    #[arg(long, value_name = "FOLDER")]
    keep: Option<PathBuf>,
}

fn main() -> ExitCode {
    match run(&Cli::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("erfgs-usbd: {error}");
            ExitCode::FAILURE
        }
    }
}

struct Served {
    server: Server,
    ledger: SharedLedger,
    counts: SharedCounts,
}

fn run(cli: &Cli) -> Result<(), Box<dyn Error>> {
    let rig = RigFile::open(&cli.rig)?.build()?;
    let mut served = BTreeMap::new();
    for BuiltDevice { name, device, counts } in rig.devices {
        let ledger = device.ledger();
        if let Some(folder) = &cli.keep {
            ledger.keep(keeper(folder, &name));
        }
        let server = Server::new(device);
        match &cli.sockets {
            Some(folder) => listen(folder, &name, server.clone())?,
            None => plug_in(&name, server.clone())?,
        }
        served.insert(name, Served { server, ledger, counts });
    }
    println!("ready");
    obey(&served, &[rig.events_line.clone(), rig.frames_line])?;
    if let Some(path) = &cli.ledger {
        write_ledger(path, &served)?;
    }
    match rig.events_line.late() {
        0 => Ok(()),
        late => Err(format!(
            "{late} trigger edges were told after the event sensors had gone past their times, and are out of order in \
             what they sent; give these devices a larger latency_ms"
        )
        .into()),
    }
}

/// Opens the file that a session of an endpoint is copied to, once for each.
fn keeper(folder: &Path, name: &str) -> impl FnMut(usize, u8) -> Option<Box<dyn std::io::Write + Send>> + Send + use<> {
    let (folder, name) = (folder.to_owned(), name.to_owned());
    let mut open: BTreeMap<(usize, u8), File> = BTreeMap::new();
    move |session, endpoint| {
        let file = match open.entry((session, endpoint)) {
            std::collections::btree_map::Entry::Occupied(entry) => entry.into_mut(),
            std::collections::btree_map::Entry::Vacant(entry) => {
                let path = folder.join(format!("{name}-{session}-{endpoint:02x}.bin"));
                entry.insert(OpenOptions::new().create(true).append(true).open(path).ok()?)
            }
        };
        file.try_clone().ok().map(|file| Box::new(file) as _)
    }
}

/// Keeps a device plugged into the kernel whenever its cable is in.
fn plug_in(name: &str, server: Server) -> Result<(), Box<dyn Error>> {
    let (first_done, first) = mpsc::channel();
    let name = name.to_owned();
    std::thread::spawn(move || {
        let mut first_done = Some(first_done);
        loop {
            while !server.with_device(|device| device.plugged(monotonic_ns())) {
                std::thread::sleep(Duration::from_millis(10));
            }
            let outcome = serve_kernel(&name, &server, &mut first_done);
            if let Err(error) = outcome {
                match first_done.take() {
                    Some(done) => {
                        // The main thread waits for this.
                        let _ = done.send(Err(error.to_string()));
                        return;
                    }
                    None => eprintln!("erfgs-usbd: {name}: {error}"),
                }
            }
            // The kernel takes a moment to free the port.
            std::thread::sleep(Duration::from_millis(100));
        }
    });
    first.recv()??;
    Ok(())
}

fn serve_kernel(
    name: &str,
    server: &Server,
    first: &mut Option<mpsc::Sender<Result<(), String>>>,
) -> Result<(), Box<dyn Error>> {
    let (ours, kernels) = UnixStream::pair()?;
    let speed = server.with_device(|device| device.speed());
    let serving = server.clone();
    let thread = std::thread::spawn(move || serving.serve(ours));
    let port = vhci::attach(&kernels, speed)?;
    drop(kernels);
    println!("{name}: plugged into port {port}");
    if let Some(done) = first.take() {
        done.send(Ok(()))?;
    }
    let outcome = thread.join().map_err(|_| "the thread that serves it failed")?;
    println!("{name}: out of port {port}");
    // The port is free already if the kernel has noticed the end of the connection first.
    let _ = vhci::detach(port);
    outcome?;
    Ok(())
}

/// Serves a device to whoever connects to its socket, one at a time.
fn listen(folder: &Path, name: &str, server: Server) -> Result<(), Box<dyn Error>> {
    let path = folder.join(format!("{name}.sock"));
    let listener = UnixListener::bind(&path).map_err(|error| format!("cannot serve at {}: {error}", path.display()))?;
    let name = name.to_owned();
    std::thread::spawn(move || {
        for stream in listener.incoming() {
            let outcome = stream.and_then(|stream| server.serve(stream));
            if let Err(error) = outcome {
                eprintln!("erfgs-usbd: {name}: {error}");
            }
        }
    });
    Ok(())
}

fn obey(served: &BTreeMap<String, Served>, lines: &[TriggerLine]) -> Result<(), Box<dyn Error>> {
    for line in std::io::stdin().lock().lines() {
        let line = line?;
        let words: Vec<&str> = line.split_whitespace().collect();
        match words[..] {
            [] => {}
            ["quit"] => return Ok(()),
            ["trigger", at_ns, level] => match at_ns.parse() {
                Ok(at_ns) => lines.iter().for_each(|line| line.push(at_ns, level == "1")),
                Err(_) => eprintln!("erfgs-usbd: {at_ns:?} is no time in nanoseconds"),
            },
            [command @ ("unplug" | "plug"), name] => match served.get(name) {
                Some(served) if command == "plug" => served.server.with_device(|device| device.plug()),
                Some(served) => served.server.with_device(|device| device.unplug()),
                None => eprintln!("erfgs-usbd: there is no device {name}"),
            },
            _ => eprintln!("erfgs-usbd: cannot do {line:?}; there are: unplug NAME, plug NAME, trigger NS 0|1, quit"),
        }
        std::io::stdout().flush()?;
    }
    // Without an input, the devices stay until the process is ended.
    loop {
        std::thread::park();
    }
}

fn write_ledger(path: &Path, served: &BTreeMap<String, Served>) -> Result<(), Box<dyn Error>> {
    let devices: BTreeMap<&String, serde_json::Value> = served
        .iter()
        .map(|(name, served)| {
            let ledger = served.ledger.lock();
            let account = serde_json::json!({
                "sessions": &ledger.sessions, "faults": ledger.faults, "counts": served.counts.get(),
            });
            (name, account)
        })
        .collect();
    fs::write(path, serde_json::to_string_pretty(&devices)?)
        .map_err(|error| format!("cannot write the ledger {}: {error}", path.display()))?;
    Ok(())
}
