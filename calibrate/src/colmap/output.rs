//! What COLMAP prints: counts of what is done, and its last words.

use std::collections::VecDeque;

/// How many of the last lines are kept for an error message.
const LINES: usize = 15;

/// The last lines that a program printed.
#[derive(Debug, Default)]
pub(super) struct Tail(VecDeque<String>);

impl Tail {
    pub fn push(&mut self, line: &str) {
        if line.is_empty() {
            return;
        }
        if self.0.len() == LINES {
            self.0.pop_front();
        }
        self.0.push_back(line.to_owned());
    }

    pub fn text(self) -> String {
        Vec::from(self.0).join("\n")
    }
}

/// The counts in `... [3/81] ...`.
pub(super) fn count(line: &str) -> Option<(usize, usize)> {
    let inside = line.split('[').skip(1).filter_map(|part| part.split(']').next());
    inside.filter_map(|part| part.split_once('/')).find_map(|(done, total)| {
        let (done, total) = (done.trim().parse().ok()?, total.trim().parse().ok()?);
        (done <= total && total > 0).then_some((done, total))
    })
}

/// How many images a mapper has, from the line that says which one it adds.
pub(super) fn registered(line: &str) -> Option<usize> {
    let (_, after) = line.split_once("Registering image #")?;
    let inside = after.split_once('(')?.1.split(')').next()?;
    let digits = inside.trim_start_matches(|c: char| !c.is_ascii_digit());
    digits.split(|c: char| !c.is_ascii_digit()).next()?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_are_read_from_the_log_of_either_version() {
        assert_eq!(count("Processed file [3/81]"), Some((3, 81)));
        assert_eq!(count("I20250101 12:00:00 1 feature_extraction.cc:258] Processed file [27/27]"), Some((27, 27)));
        assert_eq!(count("Triangulating image #5 (3)"), None);
        assert_eq!(count("[1/0] [a/b] ["), None);
    }

    #[test]
    fn a_mapper_tells_how_many_images_it_has() {
        assert_eq!(registered("Registering image #5 (3)"), Some(3));
        assert_eq!(registered("I1 1 incremental_pipeline.cc:9] Registering image #12 (num_reg_frames=7)"), Some(7));
        assert_eq!(registered("Registering image #5"), None);
        assert_eq!(registered("Triangulating image #5 (3)"), None);
    }
}
