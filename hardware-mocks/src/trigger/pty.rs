//! The modelled board behind a pseudo-terminal, in real time.

use std::{
    io::{self, ErrorKind, Read, Write},
    os::unix::fs::symlink,
    path::{Path, PathBuf},
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    thread::JoinHandle,
    time::{Duration, Instant},
};

use serialport::{SerialPort, TTYPort};

use super::{Board, Clock, Faults};

/// A board that runs on a thread of its own until it is dropped, which is to unplug it.
pub struct PtyBoard {
    path: PathBuf,
    board: Arc<Mutex<Board>>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl PtyBoard {
    /// Plugs a board in: `path` becomes a link to its terminal.
    ///
    /// # Errors
    /// If no pseudo-terminal can be had, or the link not be made.
    pub fn plug(path: &Path, clock: Clock, faults: Faults) -> io::Result<Self> {
        let (mut master, slave) = TTYPort::pair()?;
        let name = slave.name().ok_or_else(|| io::Error::other("the pseudo-terminal has no name"))?;
        symlink(name, path)?;
        let board = Arc::new(Mutex::new(Board::new(clock, faults, 0)));
        let stop = Arc::new(AtomicBool::new(false));
        let (shared, stopped) = (board.clone(), stop.clone());
        // It has power from here on, however late its thread runs.
        let began = Instant::now();
        let thread = std::thread::spawn(move || {
            // Held open, so that the terminal lives before a host opens it.
            let _slave = slave;
            let _ = master.set_timeout(Duration::from_millis(1));
            let mut buffer = [0; 256];
            while !stopped.load(Ordering::Relaxed) {
                let received = match master.read(&mut buffer) {
                    Ok(count) => &buffer[..count],
                    Err(error) if error.kind() == ErrorKind::TimedOut => &[],
                    Err(_) => return,
                };
                let now_ns = i64::try_from(began.elapsed().as_nanos()).unwrap_or(i64::MAX);
                let mut board = shared.lock().unwrap_or_else(PoisonError::into_inner);
                board.receive(received, now_ns);
                let output = board.take_output();
                drop(board);
                // Nobody reads, and the terminal is full: a serial line loses the bytes as well.
                if master.write_all(&output).is_err_and(|error| error.kind() != ErrorKind::TimedOut) {
                    return;
                }
            }
        });
        Ok(Self { path: path.to_owned(), board, stop, thread: Some(thread) })
    }

    /// Looks at the board, or does something to it.
    pub fn with<T>(&self, look: impl FnOnce(&mut Board) -> T) -> T {
        look(&mut self.board.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl Drop for PtyBoard {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        let _ = self.thread.take().map(JoinHandle::join);
        let _ = std::fs::remove_file(&self.path);
    }
}
