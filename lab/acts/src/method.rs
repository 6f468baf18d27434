//! The methods: a table, one row each.

/// A way to reconstruct a take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Method {
    /// Its name, and that of the sweep that trains with it.
    pub name: &'static str,
    /// What it is, in a few words.
    pub about: &'static str,
    /// Options of `erfgs train`.
    pub train: &'static [(&'static str, &'static str)],
    /// Whether it trains on what an ideal rig would have recorded.
    pub ideal: bool,
    /// Whether it starts from bodies (`erfgs dataset bodies`).
    pub bodies: bool,
}

/// The methods, in the order of the report.
pub const METHODS: [Method; 5] = [
    Method { name: BASELINE, about: "4DGS, frames alone", train: &[("method", "4dgs")], ideal: false, bodies: false },
    Method {
        name: "erf-gs",
        about: "ERF-GS, frames and events",
        train: &[("method", "erf-gs"), ("motion", "free-time")],
        ideal: false,
        bodies: false,
    },
    Method {
        name: "bodies-frames",
        about: "bodies on shared paths, frames alone",
        train: &[("method", "4dgs"), ("motion", "bodies")],
        ideal: false,
        bodies: true,
    },
    Method {
        name: "bodies",
        about: "bodies on shared paths, frames and events",
        train: &[("method", "erf-gs"), ("motion", "bodies")],
        ideal: false,
        bodies: true,
    },
    Method {
        name: CEILING,
        about: "4DGS on sharp frames at eight times the rate",
        train: &[("method", "4dgs")],
        ideal: true,
        bodies: false,
    },
];

/// The method that others are compared with.
pub const BASELINE: &str = "4dgs";
/// The method that says what the same cameras could show.
pub const CEILING: &str = "ceiling";

impl Method {
    /// The method of a name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        METHODS.into_iter().find(|method| method.name == name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ends_of_the_gap_are_in_the_table_and_names_differ() {
        assert!(!Method::named(BASELINE).unwrap().ideal && Method::named(CEILING).unwrap().ideal);
        for (index, method) in METHODS.iter().enumerate() {
            assert!(METHODS[..index].iter().all(|other| other.name != method.name));
            assert!(method.train.iter().any(|(key, _)| *key == "method"));
        }
    }
}
