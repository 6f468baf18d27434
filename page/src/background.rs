//! A thread with a single-threaded runtime, which ends when it is dropped.

use std::{
    io,
    thread::{self, JoinHandle},
};

use tokio::{runtime, sync::oneshot};

/// See the module. What it still does when it is dropped is not waited for.
#[derive(Debug)]
pub struct Background {
    runtime: runtime::Handle,
    quit: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Background {
    /// Starts a thread of this name.
    ///
    /// # Errors
    /// If the system has no thread or no descriptor left.
    pub fn start(name: &str) -> io::Result<Self> {
        let runtime = runtime::Builder::new_current_thread().enable_all().max_blocking_threads(4).build()?;
        let handle = runtime.handle().clone();
        let (quit, quit_signal) = oneshot::channel();
        let thread = thread::Builder::new().name(name.into()).spawn(move || {
            let _ = runtime.block_on(quit_signal);
            runtime.shutdown_background();
        })?;
        Ok(Self { runtime: handle, quit: Some(quit), thread: Some(thread) })
    }

    /// Lets it do something besides.
    pub fn spawn(&self, task: impl Future<Output = ()> + Send + 'static) {
        self.runtime.spawn(task);
    }
}

impl Drop for Background {
    fn drop(&mut self) {
        if let Some(quit) = self.quit.take() {
            let _ = quit.send(());
        }
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}
