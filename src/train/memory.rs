//! What a training will take of its device's memory, in words.

use erfgs_train::trainer::{DeviceMemory, Part};

use crate::terminal::{bytes, thousands};

/// What it will take, and a warning where the device may have too little.
/// `is_shared`: it is the processor's memory, too.
pub fn describe(memory: &DeviceMemory, adapter: &str, is_shared: bool) -> Vec<String> {
    let [start, most] = [memory.start, memory.most].map(bytes);
    let [begun, allowed] = memory.gaussians.map(|count| thousands(count.into()));
    let has = match memory.has {
        Some(has) if is_shared => format!("; {} are free, which it shares with the processor", bytes(has)),
        Some(has) => format!("; it has {} of its own", bytes(has)),
        None => "; how much it has is not known".into(),
    };
    let mut lines = vec![format!(
        "memory of {adapter}: about {start} with the {begun} Gaussians to begin with, at most {most} with the {allowed} that \
         density.max_gaussians and eds.max_gaussians allow{has}"
    )];
    if memory.may_run_out() {
        let when = match memory.begins_beyond() {
            true => "the device may have too little memory from the start",
            false => "the device may run out of memory if the training comes to have so many Gaussians",
        };
        let (part, of_part) = memory.largest;
        let enough = match memory.setting {
            Some(most) => format!("enough with --set density.max_gaussians={most} --set eds.max_gaussians={most}; "),
            None => String::new(),
        };
        let (part, remedy) = match part {
            Part::Gaussians | Part::Passing => {
                ("Gaussians and what their training keeps", "fewer initial points (--set init.max_points)")
            }
            Part::Renderings => (
                "renderings",
                "smaller images (`erfgs dataset import --scale`), or fewer renderings at a time (--set batch)",
            ),
            Part::Pictures => ("losses and levels of pixels", "smaller images (`erfgs dataset import --scale`)"),
            Part::FramesAndEvents => ("frames and events", "less for them (--device-memory)"),
        };
        lines.push(format!(
            "{when}: most of it, {}, goes to {part}; {enough}{remedy}, or another adapter (--adapter)",
            bytes(of_part)
        ));
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(has: Option<u64>, largest: Part, setting: Option<u32>) -> String {
        let gib = |count: u64| count << 30;
        let has = has.map(gib);
        let memory = DeviceMemory {
            start: gib(2),
            most: gib(9),
            gaussians: [30_000, 400_000],
            largest: (largest, gib(5)),
            has,
            setting,
        };
        describe(&memory, "a card", false).join("\n")
    }

    #[test]
    fn a_device_with_too_little_is_warned_of_with_what_takes_most_and_what_to_lower() {
        let enough = words(Some(9), Part::Gaussians, None);
        for expected in ["a card", "2.0 GiB", "30,000", "9.0 GiB", "400,000", "9.0 GiB of its own"] {
            assert!(enough.contains(expected), "{expected}: {enough}");
        }
        assert_eq!(enough.lines().count(), 1);
        let unknown = words(None, Part::Gaussians, None);
        assert!(unknown.contains("is not known") && unknown.lines().count() == 1, "{unknown}");
        let later = words(Some(8), Part::Renderings, Some(200_000));
        for expected in
            ["may run out", "5.0 GiB, goes to renderings", "density.max_gaussians=200000", "--scale", "--adapter"]
        {
            assert!(later.contains(expected), "{expected}: {later}");
        }
        let at_once = words(Some(1), Part::FramesAndEvents, None);
        assert!(at_once.contains("from the start") && at_once.contains("--device-memory"), "{at_once}");
        assert!(!at_once.contains("enough with"), "{at_once}");
    }
}
