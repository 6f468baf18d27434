//! Settings that a device did not take, though nothing failed.

use std::fmt::Display;

use serde_json::{Map, Value, json};

/// What a driver puts into a stream's settings as `not_applied` ([`Description`](erfgs_session::source::Description)),
/// and the checks before a recording tell.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct NotApplied(Vec<String>);

impl NotApplied {
    /// A setting that the device has no use for, or cannot follow: which, and why.
    pub fn because(&mut self, setting: &str, why: impl Display) {
        self.0.push(format!("{setting} ({why})"));
    }

    /// A setting that was read back: nothing is noted if it is what was asked for.
    #[cfg(any(feature = "evk4", feature = "frames"))]
    pub fn compare<T: PartialEq + Display>(&mut self, setting: &str, asked: T, now: T) {
        if asked != now {
            self.because(&format!("{setting} = {asked}"), format_args!("it has {now}"));
        }
    }

    /// Puts the list into the settings, if there is anything in it.
    pub fn tell(self, settings: &mut Map<String, Value>) {
        if !self.0.is_empty() {
            settings.insert("not_applied".into(), json!(self.0));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(any(feature = "evk4", feature = "frames"))]
    #[test]
    fn only_what_differs_is_told() {
        let mut settings = Map::new();
        let mut missed = NotApplied::default();
        missed.compare("rate_hz", 30.0, 30.0);
        missed.clone().tell(&mut settings);
        assert!(settings.is_empty());
        missed.compare("rate_hz", 30.0, 25.0);
        missed.because("focus = \"auto\"", "it has no automatic");
        missed.tell(&mut settings);
        assert_eq!(
            settings["not_applied"],
            json!(["rate_hz = 30 (it has 25)", "focus = \"auto\" (it has no automatic)"])
        );
    }
}
