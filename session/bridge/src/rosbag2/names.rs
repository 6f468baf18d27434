//! Names of topics, of which ROS 2 takes letters, digits and single underscores, no digit first.

use std::collections::HashSet;

/// The names that were given.
#[derive(Debug, Default)]
pub struct RosNames(HashSet<String>);

impl RosNames {
    /// A name for a stream that no other has.
    pub fn give(&mut self, id: &str) -> String {
        let mut name = String::new();
        for letter in id.chars() {
            let letter = if letter.is_ascii_alphanumeric() { letter } else { '_' };
            if letter != '_' || !(name.is_empty() || name.ends_with('_')) {
                name.push(letter);
            }
        }
        let plain = name.trim_end_matches('_');
        let plain = match plain.chars().next() {
            None => "stream".to_owned(),
            Some('0'..='9') => format!("camera_{plain}"),
            Some(_) => plain.to_owned(),
        };
        let mut given = plain.clone();
        for number in 2.. {
            if self.0.insert(given.clone()) {
                break;
            }
            given = format!("{plain}_{number}");
        }
        given
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_stream_has_a_name_of_its_own_that_ros_takes() {
        let mut names = RosNames::default();
        let given = ["cam-left", "cam_left", "cam--left-", "0", "-", "ev0"].map(|id| names.give(id));
        assert_eq!(given, ["cam_left", "cam_left_2", "cam_left_3", "camera_0", "stream", "ev0"]);
    }
}
