//! CPU time, beside which the clock on the wall tells little on a machine that others use, too.

/// CPU time of this thread so far, seconds; `None` where the system does not tell.
#[must_use]
pub fn thread_seconds() -> Option<f64> {
    clock::seconds(clock::Of::Thread)
}

/// CPU time of all threads of this process so far, seconds; `None` where the system does not tell.
#[must_use]
pub fn process_seconds() -> Option<f64> {
    clock::seconds(clock::Of::Process)
}

#[cfg(unix)]
mod clock {
    use rustix::time::{ClockId, clock_gettime};

    pub enum Of {
        Thread,
        Process,
    }

    pub fn seconds(of: Of) -> Option<f64> {
        let time = clock_gettime(match of {
            Of::Thread => ClockId::ThreadCPUTime,
            Of::Process => ClockId::ProcessCPUTime,
        });
        Some(time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9)
    }
}

#[cfg(not(unix))]
mod clock {
    pub enum Of {
        Thread,
        Process,
    }

    pub fn seconds(_: Of) -> Option<f64> {
        None
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn work_takes_time_of_its_thread_and_of_the_process() {
        let before = (thread_seconds().unwrap(), process_seconds().unwrap());
        let mut x = 1.0_f64;
        while thread_seconds().unwrap() < before.0 + 0.01 {
            x = std::hint::black_box(x.sin() + 1.0);
        }
        assert!(process_seconds().unwrap() >= before.1 + 0.009);
        let other = std::thread::spawn(|| thread_seconds().unwrap()).join().unwrap();
        assert!(other < 0.01, "another thread has its own: {other}");
    }
}
