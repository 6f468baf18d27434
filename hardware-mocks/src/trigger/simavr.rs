//! The real firmware in simavr (`simavr/board.c`), built on the spot: needs `avr-gcc`, `make`, a C compiler and
//! libsimavr, which `scripts/setup.sh` installs.

use std::{
    io::{self, BufRead, BufReader},
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    time::Duration,
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
        let build = folder.path().join("build");
        run(
            Command::new("make")
                .arg("-C")
                .arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("simavr"))
                .arg(format!("BUILD={}", build.display())),
            "make with avr-gcc, a C compiler and libsimavr",
        )?;
        let mut process = Command::new(build.join("board"))
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

    /// The simulator's log so far: cycle, what it tells, a value.
    fn log(&self) -> io::Result<Vec<(u64, char, String)>> {
        let log = std::fs::read_to_string(self.folder.path().join("edges"))?;
        let whole = log.rfind('\n').map_or("", |end| &log[..end]);
        let entry = |line: &str| {
            let mut fields = line.split(' ');
            Some((fields.next()?.parse().ok()?, fields.next()?.chars().next()?, fields.next()?.to_owned()))
        };
        let entries: Option<Vec<_>> = whole.lines().map(entry).collect();
        entries.ok_or_else(damaged)
    }

    /// All changes of the ports so far.
    ///
    /// # Errors
    /// If the log cannot be read.
    pub fn changes(&self) -> io::Result<Vec<PortChange>> {
        let of_ports = self.log()?.into_iter().filter(|entry| entry.1 != 'L');
        let change = |(cycle, port, value): (u64, char, String)| {
            Ok(PortChange { cycle, port, value: u8::from_str_radix(&value, 16).map_err(|_| damaged())? })
        };
        of_ports.map(change).collect()
    }

    /// How far the simulation was ever behind the wall clock, up to now: longer than a moment only if this machine has no
    /// processor time left for it.
    ///
    /// # Errors
    /// If the log cannot be read.
    pub fn worst_lag(&self) -> io::Result<Duration> {
        match self.log()?.into_iter().rfind(|entry| entry.1 == 'L') {
            Some((_, _, milliseconds)) => Ok(Duration::from_millis(milliseconds.parse().map_err(|_| damaged())?)),
            None => Ok(Duration::ZERO),
        }
    }
}

fn damaged() -> io::Error {
    io::Error::other("the simulator's log is damaged")
}

impl Drop for SimulatedBoard {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
