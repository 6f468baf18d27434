//! What was wrong with a stream.

/// Anomalies of a stream by class. Decoders never stop at one: they skip what cannot be right, count it and go on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Anomalies {
    /// Events and edges that came while the time was unknown (before the first time word, or while a jump of time
    /// waited to be confirmed); skipped.
    pub undated: u64,
    /// Events outside the sensor; skipped.
    pub outside: u64,
    /// Events before the first row address (EVT3, DAVIS); skipped.
    pub no_row: u64,
    /// Vectors of events without a base address (EVT3); skipped.
    pub no_base: u64,
    /// Time words that went back and that no later one confirmed; ignored. In formats whose items carry their own time
    /// (DAT, AEDAT2, AEDAT4, CSV) the items whose time went back; kept as they are.
    pub time_backward: u64,
    /// Roll-overs of the device's clock that were lost with the data and counted again with the host's clock.
    pub loops_restored: u64,
    /// Jumps of time whose length is unknown; each was told to [`super::Sink::discontinuity`].
    pub discontinuities: u64,
    /// Items of several words that were cut short; skipped.
    pub incomplete: u64,
    /// Words or items of a type that the format does not define; skipped.
    pub unknown: u64,
    /// Packets or lines that cannot be decoded; skipped.
    pub damaged: u64,
    /// Bytes at the end of the stream that make no whole item.
    pub truncated_bytes: u64,
}

impl Anomalies {
    /// The classes by name, in the order of their declaration.
    #[must_use]
    pub fn classes(&self) -> [(&'static str, u64); 11] {
        [
            ("undated", self.undated),
            ("outside", self.outside),
            ("no_row", self.no_row),
            ("no_base", self.no_base),
            ("time_backward", self.time_backward),
            ("loops_restored", self.loops_restored),
            ("discontinuities", self.discontinuities),
            ("incomplete", self.incomplete),
            ("unknown", self.unknown),
            ("damaged", self.damaged),
            ("truncated_bytes", self.truncated_bytes),
        ]
    }

    /// Whether nothing can be read of a file that gave so many events and other items: all of it is anomalies.
    #[must_use]
    pub fn are_all(&self, items: u64) -> bool {
        items == 0 && !self.is_empty()
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}

impl std::fmt::Display for Anomalies {
    /// The classes that there are, with their counts: `3 damaged, 1 truncated_bytes`; `none` without any.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let found =
            self.classes().into_iter().filter(|class| class.1 > 0).map(|(name, count)| format!("{count} {name}"));
        let found: Vec<String> = found.collect();
        if found.is_empty() { f.write_str("none") } else { f.write_str(&found.join(", ")) }
    }
}
