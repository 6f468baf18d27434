//! The real firmware in simavr (`simavr/board.c`), built on the spot: needs `avr-gcc`, `make`, a C compiler and
//! libsimavr, which `scripts/setup.sh` installs.

use std::{
    io::{self, BufRead, BufReader},
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
};

use tempfile::TempDir;

/// A change of an output port.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PortChange {
    /// The processor's cycle since the first power-on, at 16 MHz.
    pub cycle: u64,
    /// `'B'` (D8 to D13) or `'C'` (A0 to A5).
    pub port: char,
    /// Its new value.
    pub value: u8,
}

/// An ATmega328P that runs the firmware at the pace of the wall clock, its serial line on a pseudo-terminal.
pub struct SimulatedBoard {
    process: Child,
    folder: TempDir,
}

fn run(command: &mut Command, what: &str) -> io::Result<()> {
    let output = command.output().map_err(|error| {
        io::Error::new(error.kind(), format!("cannot run {what}: {error}; scripts/setup.sh installs it"))
    })?;
    if output.status.success() {
        return Ok(());
    }
    let text = String::from_utf8_lossy(&output.stderr);
    Err(io::Error::other(format!("{what} failed; scripts/setup.sh installs what it needs:\n{text}")))
}

impl SimulatedBoard {
    /// Builds firmware and simulator, and powers the board.
    ///
    /// # Errors
    /// If a tool is missing or fails; the message says which.
    pub fn power() -> io::Result<Self> {
        let folder = tempfile::tempdir()?;
        let here = Path::new(env!("CARGO_MANIFEST_DIR"));
        let build = folder.path().join("build");
        run(
            Command::new("make").arg("-C").arg(here.join("../rig/firmware")).arg(format!("BUILD={}", build.display())),
            "make with avr-gcc",
        )?;
        let simulator = folder.path().join("board");
        run(
            Command::new("cc")
                .args(["-std=gnu11", "-O2", "-Wall", "-Wextra", "-Werror", "-o"])
                .arg(&simulator)
                .arg(here.join("simavr/board.c"))
                .args(["-lsimavr", "-lelf", "-lutil"]),
            "cc with libsimavr",
        )?;
        let mut process = Command::new(simulator)
            .arg(build.join("firmware.elf"))
            .arg(folder.path().join("tty"))
            .arg(folder.path().join("edges"))
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()?;
        let output = process.stdout.take().ok_or_else(|| io::Error::other("the simulator has no output"))?;
        // simavr itself speaks first.
        for line in BufReader::new(output).lines() {
            if line? == "ready" {
                return Ok(Self { process, folder });
            }
        }
        Err(io::Error::other("the simulator ended before it was ready"))
    }

    /// The serial port's path.
    #[must_use]
    pub fn port(&self) -> PathBuf {
        self.folder.path().join("tty")
    }

    /// Presses the reset button.
    ///
    /// # Errors
    /// If the simulator is gone.
    pub fn reset(&self) -> io::Result<()> {
        run(Command::new("kill").arg("-USR1").arg(self.process.id().to_string()), "kill")
    }

    /// All changes of the ports so far.
    ///
    /// # Errors
    /// If the log cannot be read.
    pub fn changes(&self) -> io::Result<Vec<PortChange>> {
        let log = std::fs::read_to_string(self.folder.path().join("edges"))?;
        let whole = log.rfind('\n').map_or("", |end| &log[..end]);
        let change = |line: &str| {
            let mut fields = line.split(' ');
            Some(PortChange {
                cycle: fields.next()?.parse().ok()?,
                port: fields.next()?.chars().next()?,
                value: u8::from_str_radix(fields.next()?, 16).ok()?,
            })
        };
        let changes: Option<Vec<_>> = whole.lines().map(change).collect();
        changes.ok_or_else(|| io::Error::other("the simulator's log is damaged"))
    }
}

impl Drop for SimulatedBoard {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
