//! When a frame was exposed.

/// The exposure of a frame, in session time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Exposure {
    /// Its middle, nanoseconds.
    pub mid_ns: i64,
    /// Its length, nanoseconds; `None` where nothing tells.
    pub length_ns: Option<i64>,
}

impl Exposure {
    /// One that begins at `open_ns` and lasts `length_ns`.
    #[must_use]
    pub fn beginning(open_ns: i64, length_ns: i64) -> Self {
        Self { mid_ns: open_ns.saturating_add(length_ns / 2), length_ns: Some(length_ns) }
    }

    /// One that begins and ends at these times.
    #[must_use]
    pub fn between([open_ns, close_ns]: [i64; 2]) -> Self {
        Self::beginning(open_ns, close_ns.saturating_sub(open_ns))
    }

    /// When it begins and ends; both are its middle where nothing tells its length.
    #[must_use]
    pub fn span_ns(&self) -> [i64; 2] {
        let length_ns = self.length_ns.unwrap_or(0);
        let open_ns = self.mid_ns.saturating_sub(length_ns / 2);
        [open_ns, open_ns.saturating_add(length_ns)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn its_span_is_what_it_was_made_of() {
        for span in [[0, 0], [10, 13], [-4, -1], [-3, 8]] {
            assert_eq!(Exposure::between(span).span_ns(), span);
        }
        assert_eq!(Exposure::between([10, 13]), Exposure { mid_ns: 11, length_ns: Some(3) });
        assert_eq!(Exposure { mid_ns: 7, length_ns: None }.span_ns(), [7, 7]);
    }
}
