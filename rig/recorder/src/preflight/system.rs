//! The system: memory for USB transfers and queues, and the clock that everything is stamped with.

use std::{fs, path::Path};

use erfgs_session::source::Description;

use super::{Finding, Plan};

/// Bytes that an event camera keeps in flight where its stream does not say.
const IN_FLIGHT: u64 = 4 << 20;
/// Clocks that are read in nanoseconds and do not jump.
const GOOD_CLOCKS: [&str; 4] = ["tsc", "kvm-clock", "arch_sys_counter", "hyperv_clocksource_tsc_page"];

pub(super) fn check(plan: &Plan<'_>, root: &Path) -> Vec<Finding> {
    let read = |path: &str| fs::read_to_string(root.join(path)).ok();
    [
        read("sys/module/usbcore/parameters/usbfs_memory_mb").and_then(|text| usbfs(&text, plan.streams)),
        read("proc/meminfo").and_then(|text| memory(&text, plan.queue_bytes)),
        read("sys/devices/system/clocksource/clocksource0/current_clocksource").map(|text| clock(text.trim())),
    ]
    .into_iter()
    .flatten()
    .collect()
}

fn usbfs(limit_mib: &str, streams: &[Description]) -> Option<Finding> {
    const CHECK: &str = "usbfs memory";
    let limit = limit_mib.trim().parse::<u64>().ok()? << 20;
    let needs = streams.iter().map(in_flight).fold(0, u64::saturating_add);
    // 0 means that there is no limit.
    if needs == 0 || limit == 0 {
        return None;
    }
    let says = format!(
        "the cameras keep {} MiB of USB transfers in flight; the kernel allows {} MiB for all programs together",
        needs.div_ceil(1 << 20),
        limit >> 20
    );
    Some(if needs > limit {
        let remedy = "as root: echo 256 > /sys/module/usbcore/parameters/usbfs_memory_mb (until the next start), or \
                      usbcore.usbfs_memory_mb=256 on the kernel's command line";
        Finding::warning(CHECK, says, remedy)
    } else {
        Finding::good(CHECK, says)
    })
}

/// Bytes that a stream keeps in flight. Cameras of the kernel's own drivers take none of this memory, and tell of no transfers.
fn in_flight(stream: &Description) -> u64 {
    let number = |name: &str| stream.settings.get("stream")?.get(name)?.as_u64();
    match (number("wanted_transfers").or_else(|| number("transfers")), number("transfer_bytes")) {
        (Some(transfers), Some(bytes)) => transfers.saturating_mul(bytes),
        _ if stream.encoding.is_events() && !stream.model.contains("(no camera)") => IN_FLIGHT,
        _ => 0,
    }
}

fn memory(meminfo: &str, queues: u64) -> Option<Finding> {
    const CHECK: &str = "memory";
    let available = erfgs_base::memory::of_system(meminfo)?;
    let says = format!("the queues may take {} MiB; {} MiB are available", queues >> 20, available >> 20);
    Some(if queues > available {
        Finding::warning(
            CHECK,
            says,
            "lower queue_mib, or close other programs: the system ends one that takes too much",
        )
    } else {
        Finding::good(CHECK, says)
    })
}

fn clock(source: &str) -> Finding {
    const CHECK: &str = "clock";
    if GOOD_CLOCKS.contains(&source) {
        return Finding::good(CHECK, format!("the system's clock is {source}"));
    }
    let says = format!("the system's clock is {source}, which is slow to read or coarse");
    Finding::warning(
        CHECK,
        says,
        "check why the kernel does not use tsc (`dmesg | grep clocksource`); arrival times are noisier",
    )
}

#[cfg(test)]
mod tests {
    use erfgs_events::EventEncoding;
    use erfgs_scene::pixel::PixelFormat;
    use erfgs_session::source::Encoding;

    use super::{super::Verdict, *};

    fn camera(settings: serde_json::Value) -> Description {
        let serde_json::Value::Object(settings) = settings else { panic!("an object is wanted") };
        let (id, model, serial) = ("a".into(), "EVK4".into(), String::new());
        Description {
            id,
            model,
            serial,
            encoding: Encoding::Events(EventEncoding::Evt3),
            width: 1280,
            height: 720,
            start_order: 0,
            settings,
        }
    }

    #[test]
    fn transfers_are_summed_against_the_kernels_limit() {
        let small = || camera(serde_json::json!({}));
        let large = || camera(serde_json::json!({ "stream": { "transfers": 64, "transfer_bytes": 262_144 } }));
        let frames = |settings| Description { encoding: Encoding::Frames(PixelFormat::Grey8), ..camera(settings) };
        // A share of what is wanted, which is told.
        let u3v = || {
            let stream = serde_json::json!({ "transfers": 12, "wanted_transfers": 40, "transfer_bytes": 262_144 });
            frames(serde_json::json!({ "backend": "u3v", "stream": stream }))
        };
        let verdict = |limit, streams: &[Description]| usbfs(limit, streams).map(|finding| finding.verdict);
        assert_eq!(verdict("16\n", &[small(), small(), small(), small()]), Some(Verdict::Good));
        assert_eq!(verdict("16\n", &[small(), large()]), Some(Verdict::Warning));
        // 10 MiB of a USB3 Vision camera and 4 MiB of each event camera; a V4L2 camera takes none.
        assert_eq!(verdict("16\n", &[u3v(), small()]), Some(Verdict::Good));
        assert_eq!(verdict("16\n", &[u3v(), small(), small()]), Some(Verdict::Warning));
        assert_eq!(verdict("16\n", &[frames(serde_json::json!({ "backend": "precise" }))]), None);
        assert!(usbfs("16\n", &[u3v(), small()]).unwrap().says.contains("keep 14 MiB"));
        assert_eq!(verdict("0\n", &[large()]), None);
        assert_eq!(verdict("16\n", &[]), None);
    }

    #[test]
    fn queues_beyond_the_memory_are_told() {
        let text = "MemTotal: 8000000 kB\nMemAvailable:    1048576 kB\n";
        assert_eq!(memory(text, 1 << 30).unwrap().verdict, Verdict::Good);
        assert_eq!(memory(text, (1 << 30) + 1).unwrap().verdict, Verdict::Warning);
        assert!(memory("nonsense", 1).is_none());
    }

    #[test]
    fn coarse_clocks_are_told() {
        assert_eq!([clock("tsc").verdict, clock("hpet").verdict], [Verdict::Good, Verdict::Warning]);
    }
}
