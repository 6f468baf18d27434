//! The description of the streams in a file's header: XML of nested `node` and `attr` elements.

use super::super::SensorSize;

/// What a stream carries, by the identifier of its packets.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Aedat4Kind {
    /// `EVTS`: events.
    Events,
    /// `FRME`: frames.
    Frames,
    /// `IMUS`: inertial samples.
    Imu,
    /// `TRIG`: marks.
    Triggers,
}

impl Aedat4Kind {
    pub(super) const ALL: [(Self, [u8; 4], &str); 4] = [
        (Self::Events, *b"EVTS", "events"),
        (Self::Frames, *b"FRME", "frames"),
        (Self::Imu, *b"IMUS", "imu"),
        (Self::Triggers, *b"TRIG", "triggers"),
    ];

    pub(super) fn identifier(self) -> [u8; 4] {
        Self::ALL.into_iter().find(|kind| kind.0 == self).map_or(*b"EVTS", |kind| kind.1)
    }
}

/// A stream of a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Aedat4Stream {
    /// Number of the stream in packets.
    pub id: u32,
    /// What it carries; `None` if it is something that is not read.
    pub kind: Option<Aedat4Kind>,
    /// Size of the sensor, for events and frames.
    pub size: Option<SensorSize>,
    /// Model and serial number of the camera.
    pub source: String,
}

/// The streams that a description names.
pub(super) fn parse(xml: &str) -> Result<Vec<Aedat4Stream>, String> {
    let document = roxmltree::Document::parse(xml).map_err(|error| format!("its description is no XML: {error}"))?;
    let child = |node: roxmltree::Node<'_, '_>, name: &str| {
        node.children()
            .find(|child| child.has_tag_name("node") && child.attribute("name") == Some(name))
            .map(|n| n.id())
    };
    let attribute = |node: roxmltree::Node<'_, '_>, key: &str| {
        let found = node.children().find(|child| child.has_tag_name("attr") && child.attribute("key") == Some(key));
        found.and_then(|attribute| attribute.text()).map(|text| text.trim().to_owned())
    };
    let outputs = child(document.root_element(), "outInfo").and_then(|id| document.get_node(id));
    let outputs = outputs.ok_or("its description has no node `outInfo`")?;
    let mut streams = Vec::new();
    for node in outputs.children().filter(|node| node.has_tag_name("node")) {
        let name = node.attribute("name").unwrap_or_default();
        let id = name.parse().map_err(|_| format!("its description has a stream `{name}`, which is no number"))?;
        let identifier = attribute(node, "typeIdentifier").unwrap_or_default();
        let kind = Aedat4Kind::ALL.into_iter().find(|kind| kind.1 == identifier.as_bytes()).map(|kind| kind.0);
        let info = child(node, "info").and_then(|id| document.get_node(id));
        let side = |key| info.and_then(|info| attribute(info, key)).and_then(|text| text.parse::<u16>().ok());
        let size = side("sizeX").zip(side("sizeY")).map(|(width, height)| SensorSize { width, height });
        let source = info.and_then(|info| attribute(info, "source")).unwrap_or_default();
        streams.push(Aedat4Stream { id, kind, size, source });
    }
    Ok(streams)
}

/// The description of streams, as DV writes it.
pub(super) fn write(streams: &[Aedat4Stream], compression: &str) -> String {
    let escape = |text: &str| text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;");
    let mut xml =
        String::from("<dv version=\"2.0\">\n  <node name=\"outInfo\" path=\"/mainloop/Recorder/outInfo/\">\n");
    let attr = |indent: &str, key: &str, kind: &str, value: &str| {
        format!("{indent}<attr key=\"{key}\" type=\"{kind}\">{}</attr>\n", escape(value))
    };
    for stream in streams {
        let Some((_, identifier, output)) = Aedat4Kind::ALL.into_iter().find(|kind| Some(kind.0) == stream.kind) else {
            continue;
        };
        let path = format!("/mainloop/Recorder/outInfo/{}/", stream.id);
        xml += &format!("    <node name=\"{}\" path=\"{path}\">\n", stream.id);
        xml += &attr("      ", "compression", "string", compression);
        xml += &attr("      ", "originalModuleName", "string", "capture");
        xml += &attr("      ", "originalOutputName", "string", output);
        xml += &attr("      ", "typeIdentifier", "string", &String::from_utf8_lossy(&identifier));
        xml += &format!("      <node name=\"info\" path=\"{path}info/\">\n");
        if let Some(SensorSize { width, height }) = stream.size {
            xml += &attr("        ", "sizeX", "int", &width.to_string());
            xml += &attr("        ", "sizeY", "int", &height.to_string());
        }
        xml += &attr("        ", "source", "string", &stream.source);
        xml += "      </node>\n    </node>\n";
    }
    xml + "  </node>\n</dv>\n"
}
