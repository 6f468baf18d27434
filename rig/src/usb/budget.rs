//! Memory that Linux lets all programs together put into USB transfers, and what of it a rig may use.

use super::{Bus, Flight, cameras};

const LIMIT_FILE: &str = "/sys/module/usbcore/parameters/usbfs_memory_mb";

/// The limit of usbfs, bytes; `None` where there is none (0 MiB means no limit) or it cannot be read (no Linux, no
/// USB module).
#[must_use]
fn usbfs_limit_bytes() -> Option<usize> {
    parse_limit(&std::fs::read_to_string(LIMIT_FILE).ok()?)
}

fn parse_limit(text: &str) -> Option<usize> {
    match text.trim().parse::<usize>() {
        Ok(0) | Err(_) => None,
        Ok(mebibytes) => mebibytes.checked_mul(1 << 20),
    }
}

/// What to do when the kernel refuses memory.
#[must_use]
pub fn memory_advice() -> String {
    let now = match usbfs_limit_bytes() {
        Some(bytes) => format!("the limit of all programs together is {} MiB now", bytes >> 20),
        None => format!("see {LIMIT_FILE}"),
    };
    format!(
        "{now}. Raise it, as root: `echo 256 > {LIMIT_FILE}` (until the next start), or add usbcore.usbfs_memory_mb=256 \
         to the kernel's command line. Or lower the `transfers` of the camera"
    )
}

/// Divides the memory of usbfs among the streams of a rig.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Budget {
    /// Bytes that all streams may keep in flight together; `None`: no limit.
    pub limit: Option<usize>,
    /// Cameras that share it.
    pub cameras: usize,
}

impl Budget {
    /// The budget of this machine for one of the cameras on a bus: event cameras and USB3 Vision cameras share it.
    #[must_use]
    pub fn on(bus: &dyn Bus) -> Self {
        Self { limit: usbfs_limit_bytes(), cameras: cameras::count(bus) }
    }

    /// As many of the transfers that `wanted` asks for as fit this camera's share of three quarters of the limit (the
    /// rest is for control transfers and other programs), but never fewer than two: one being filled while another is
    /// handed over.
    #[must_use]
    pub fn fit(self, wanted: Flight) -> Flight {
        let Some(limit) = self.limit else { return wanted };
        let share = limit / 4 * 3 / self.cameras.max(1);
        let transfers = (share / wanted.bytes.max(1)).clamp(2, wanted.transfers.max(2));
        Flight { transfers, ..wanted }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn zero_and_nonsense_mean_no_limit() {
        assert_eq!(parse_limit("16\n"), Some(16 << 20));
        assert_eq!(parse_limit("0\n"), None);
        assert_eq!(parse_limit("many"), None);
    }

    #[test]
    fn four_cameras_share_sixteen_mebibytes() {
        let wanted = Flight { transfers: 32, bytes: 1 << 17 };
        assert_eq!(Budget { limit: Some(16 << 20), cameras: 1 }.fit(wanted), wanted);
        assert_eq!(Budget { limit: Some(16 << 20), cameras: 4 }.fit(wanted).transfers, 24);
        assert_eq!(Budget { limit: Some(1 << 17), cameras: 4 }.fit(wanted).transfers, 2);
        assert_eq!(Budget { limit: None, cameras: 4 }.fit(wanted), wanted);
    }
}
