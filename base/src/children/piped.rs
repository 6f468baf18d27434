//! Programs that are fed or read while they run.

use std::{
    io,
    process::{Child, Command, ExitStatus},
    sync::{Arc, Condvar, Mutex, PoisonError},
    thread,
    time::Duration,
};

use super::{Group, end_group, watch::Watch};

/// A program whose pipes are in use. While this process waits for it ([`Piped::waits`]) it is watched, and ended where it hangs. It
/// is also ended when this is dropped.
#[derive(Debug)]
pub struct Piped {
    group: Group,
    shared: Arc<Shared>,
}

#[derive(Debug, Default)]
struct Shared {
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Clone, Copy, Debug, Default)]
struct State {
    /// Whether this process waits for it.
    is_waited_for: bool,
    /// Grows with each wait.
    waits: u64,
    hung: bool,
    over: bool,
}

impl Shared {
    fn set(&self, change: impl FnOnce(&mut State)) {
        change(&mut self.state.lock().unwrap_or_else(PoisonError::into_inner));
        self.changed.notify_all();
    }

    fn get(&self) -> State {
        *self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Piped {
    /// Starts `command`, whose pipes are as it says. It hangs if for `idle` none of its threads runs or uses processor time while it
    /// is waited for.
    ///
    /// # Errors
    /// If it cannot be started.
    pub fn start(command: Command, idle: Duration) -> io::Result<Self> {
        let group = Group::start(command)?;
        let shared = Arc::new(Shared::default());
        let (of_thread, id) = (shared.clone(), group.id);
        thread::Builder::new().name("watch of a program".into()).spawn(move || watch(&of_thread, id, idle))?;
        Ok(Self { group, shared })
    }

    /// The program.
    pub fn child(&mut self) -> &mut Child {
        &mut self.group.child
    }

    /// Does something that waits for the program.
    ///
    /// # Errors
    /// Those of `work`; [`io::ErrorKind::TimedOut`] where the program was ended since it hung.
    pub fn waits<T>(&mut self, work: impl FnOnce(&mut Child) -> io::Result<T>) -> io::Result<T> {
        self.shared.set(|state| {
            state.is_waited_for = true;
            state.waits += 1;
        });
        let done = work(&mut self.group.child);
        self.shared.set(|state| state.is_waited_for = false);
        self.or_hung(done)
    }

    /// Waits for its end.
    ///
    /// # Errors
    /// If that cannot be waited for, or with [`io::ErrorKind::TimedOut`] where the program was ended since it hung.
    pub fn wait(&mut self) -> io::Result<ExitStatus> {
        self.shared.set(|state| state.is_waited_for = true);
        let status = self.group.wait();
        self.shared.set(|state| (state.is_waited_for, state.over) = (false, true));
        self.or_hung(status)
    }

    fn or_hung<T>(&self, done: io::Result<T>) -> io::Result<T> {
        if self.shared.get().hung {
            let what = "the program stood still without computing anything, and was ended; try again";
            return Err(io::Error::new(io::ErrorKind::TimedOut, what));
        }
        done
    }
}

impl Drop for Piped {
    fn drop(&mut self) {
        self.shared.set(|state| state.over = true);
    }
}

/// Ends the group if it hangs while it is waited for, until it is over.
fn watch(shared: &Shared, id: u32, idle: Duration) {
    let mut watch = Watch::new(id, idle);
    let mut waits = 0;
    loop {
        let state = shared.state.lock().unwrap_or_else(PoisonError::into_inner);
        let state = if state.is_waited_for || state.over {
            let every = watch.look_every;
            shared
                .changed
                .wait_timeout_while(state, every, |state| !state.over)
                .map_or_else(|poisoned| poisoned.into_inner().0, |(state, _)| state)
        } else {
            shared.changed.wait(state).unwrap_or_else(PoisonError::into_inner)
        };
        let now = *state;
        drop(state);
        if now.over {
            return;
        }
        if !now.is_waited_for || std::mem::replace(&mut waits, now.waits) != now.waits {
            watch.is_busy();
        } else if watch.hangs() {
            // Held, so that the group's number is not another's by now.
            let list = crate::ending::list();
            if list.children.contains(&id) {
                shared.set(|state| state.hung = true);
                end_group(id);
            }
            return;
        }
    }
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;
    use std::{
        io::{Read, Write},
        process::Stdio,
    };

    fn piped(script: &str) -> Piped {
        let mut command = Command::new("sh");
        command.args(["-c", script]).stdin(Stdio::piped()).stdout(Stdio::piped());
        Piped::start(command, Duration::from_millis(400)).unwrap()
    }

    #[test]
    fn a_program_that_hangs_while_it_is_read_fed_or_waited_for_is_ended() {
        let mut byte = [0];
        let read = piped("sleep 600").waits(|child| child.stdout.as_mut().unwrap().read_exact(&mut byte));
        assert_eq!(read.map_err(|error| error.kind()), Err(io::ErrorKind::TimedOut));
        let fed = piped("sleep 600").waits(|child| child.stdin.as_mut().unwrap().write_all(&[0; 1 << 20]));
        assert_eq!(fed.map_err(|error| error.kind()), Err(io::ErrorKind::TimedOut));
        let ended = piped("sleep 600").wait();
        assert_eq!(ended.map_err(|error| error.kind()), Err(io::ErrorKind::TimedOut));
    }

    #[test]
    fn a_program_that_waits_for_us_does_not_hang() {
        let mut program = piped("echo a; read line; echo \"$line\"");
        let mut byte = [0];
        program.waits(|child| child.stdout.as_mut().unwrap().read_exact(&mut byte)).unwrap();
        thread::sleep(Duration::from_secs(2));
        program.waits(|child| child.stdin.as_mut().unwrap().write_all(b"b\n")).unwrap();
        let mut rest = String::new();
        program.waits(|child| child.stdout.as_mut().unwrap().read_to_string(&mut rest)).unwrap();
        assert_eq!((byte, rest.as_str()), ([b'a'], "\nb\n"));
        assert!(program.wait().unwrap().success());
    }
}
