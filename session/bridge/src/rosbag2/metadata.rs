//! `metadata.yaml`, by which ROS 2 knows a bag.

use std::fmt::Write;

use crate::log::FinishedLog;

/// Who comes late hears what was published last, as with every publisher of `/tf_static`.
const LATCHED: &str = "- history: 1\n  depth: 1\n  reliability: 1\n  durability: 1\n  deadline:\n    sec: 9223372036\n    \
                       nsec: 854775807\n  lifespan:\n    sec: 9223372036\n    nsec: 854775807\n  liveliness: 1\n  \
                       liveliness_lease_duration:\n    sec: 9223372036\n    nsec: 854775807\n  \
                       avoid_ros_namespace_conventions: false";

/// The quality of service that a topic is offered with; empty for that of the player.
pub fn offered_qos(topic: &str) -> &'static str {
    if topic == super::TRANSFORMS { LATCHED } else { "" }
}

/// A name within double quotes.
fn quoted(text: &str) -> String {
    let escaped = text.chars().map(|letter| match letter {
        '"' | '\\' => format!("\\{letter}"),
        '\n' => "\\n".to_owned(),
        letter if letter.is_control() => format!("\\U{:08x}", u32::from(letter)),
        letter => letter.to_string(),
    });
    format!("\"{}\"", escaped.collect::<String>())
}

/// The text, in version 5, which every distribution since Humble reads.
pub fn text(file: &str, log: &FinishedLog) -> String {
    let file = quoted(file);
    let [first, last] = log.span_ns.unwrap_or_default();
    let messages: u64 = log.topics.iter().map(|topic| topic.messages).sum();
    let times = |indent: &str| {
        format!(
            "{indent}duration:\n{indent}  nanoseconds: {}\n{indent}starting_time:\n{indent}  nanoseconds_since_epoch: {first}\n",
            last - first
        )
    };
    let mut text = "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: mcap\n".to_owned();
    text += &times("  ");
    let _ = writeln!(text, "  message_count: {messages}\n  topics_with_message_count:");
    for topic in &log.topics {
        let qos = quoted(offered_qos(&topic.topic));
        let _ = write!(
            text,
            "    - topic_metadata:\n        name: {}\n        type: {}\n        serialization_format: cdr\n        \
             offered_qos_profiles: {qos}\n      message_count: {}\n",
            topic.topic, topic.schema, topic.messages
        );
    }
    let _ = write!(
        text,
        "  compression_format: \"\"\n  compression_mode: \"\"\n  relative_file_paths:\n    - {file}\n  files:\n    - path: {file}\n{}      \
         message_count: {messages}\n",
        times("      ")
    );
    text
}
