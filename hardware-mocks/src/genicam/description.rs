//! What the emulated camera says of its features (GenApi), and that in an archive.

use std::fmt::Write;

use super::registers::{CHUNKS, FORMATS, Order, feature};

/// What differs between the transports.
pub(crate) struct Wire {
    /// The transport, as the model's name has it.
    pub transport: &'static str,
    /// The same, as GenApi has it.
    pub namespace: &'static str,
    /// How bytes lie.
    pub order: Order,
    /// Where the features begin.
    pub features: u64,
    /// Where maker, model and serial number are, and how long.
    pub strings: [(u32, u32); 3],
    /// Most bytes a second of the link.
    pub most_bytes_s: u32,
}

/// The description of a camera with a sensor of this size.
pub(crate) fn text(wire: &Wire, sensor: [u32; 2]) -> String {
    let mut xml = format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<RegisterDescription ModelName=\"Emulated{}\" VendorName=\"erfgs\" ToolTip=\"\" \
         StandardNameSpace=\"{}\" SchemaMajorVersion=\"1\" SchemaMinorVersion=\"1\" SchemaSubMinorVersion=\"0\" MajorVersion=\"1\" \
         MinorVersion=\"0\" SubMinorVersion=\"0\" ProductGuid=\"11111111-1111-1111-1111-111111111113\" \
         VersionGuid=\"11111111-1111-1111-1111-111111111114\" xmlns=\"http://www.genicam.org/GenApi/Version_1_1\">\n",
        wire.transport, wire.namespace
    );
    let mut body = Body { xml: String::new(), listed: Vec::new(), wire };
    body.strings();
    body.region(sensor);
    body.exposure();
    body.acquisition();
    body.lines();
    body.chunks();
    let listed: String = body.listed.iter().map(|name| format!("<pFeature>{name}</pFeature>")).collect();
    let _ = writeln!(xml, "<Category Name=\"Root\" NameSpace=\"Standard\">{listed}</Category>");
    xml += &body.xml;
    xml + "<Port Name=\"Device\" NameSpace=\"Standard\"/>\n</RegisterDescription>\n"
}

struct Body<'a> {
    xml: String,
    listed: Vec<String>,
    wire: &'a Wire,
}

impl Body<'_> {
    fn order(&self) -> &'static str {
        match self.wire.order {
            Order::Big => "BigEndian",
            Order::Little => "LittleEndian",
        }
    }

    /// A node that users see.
    fn node(&mut self, kind: &str, name: &str, inside: &str) {
        self.listed.push(name.to_owned());
        let _ = writeln!(self.xml, "<{kind} Name=\"{name}\" NameSpace=\"Standard\">{inside}</{kind}>");
    }

    /// The register behind a node.
    fn register(&mut self, kind: &str, name: &str, at: u32, access: &str) {
        let sign = if kind == "IntReg" { "<Sign>Unsigned</Sign>" } else { "" };
        let (at, order) = (self.wire.features + u64::from(at), self.order());
        let _ = writeln!(
            self.xml,
            "<{kind} Name=\"{name}Reg\"><Address>{at:#x}</Address><Length>4</Length><AccessMode>{access}</AccessMode>\
             <pPort>Device</pPort><Cachable>NoCache</Cachable>{sign}<Endianess>{order}</Endianess></{kind}>"
        );
    }

    fn integer(&mut self, name: &str, at: u32, access: &str, limits: &str) {
        self.node("Integer", name, &format!("{LOCKED}<pValue>{name}Reg</pValue>{limits}"));
        self.register("IntReg", name, at, access);
    }

    fn choice(&mut self, name: &str, at: u32, entries: &[(&str, u32)], more: &str) {
        let entries: String = entries
            .iter()
            .map(|(name, value)| {
                format!("<EnumEntry Name=\"{name}\" NameSpace=\"Standard\"><Value>{value}</Value></EnumEntry>")
            })
            .collect();
        self.node("Enumeration", name, &format!("{more}{entries}<pValue>{name}Reg</pValue>"));
        self.register("IntReg", name, at, "RW");
    }

    fn command(&mut self, name: &str, register: &str, value: u32) {
        self.node("Command", name, &format!("<pValue>{register}Reg</pValue><CommandValue>{value}</CommandValue>"));
    }

    fn flag(&mut self, name: &str, at: u32) {
        self.node("Boolean", name, &format!("<pValue>{name}Reg</pValue><OnValue>1</OnValue><OffValue>0</OffValue>"));
        self.register("IntReg", name, at, "RW");
    }

    fn strings(&mut self) {
        let names = ["DeviceVendorName", "DeviceModelName", "DeviceSerialNumber"];
        for (name, (at, length)) in names.into_iter().zip(self.wire.strings) {
            let inside = format!(
                "<Address>{at:#x}</Address><Length>{length}</Length><AccessMode>RO</AccessMode><pPort>Device</pPort>"
            );
            self.node("StringReg", name, &inside);
        }
    }

    fn region(&mut self, [columns, rows]: [u32; 2]) {
        for (name, most) in [("SensorWidth", columns), ("SensorHeight", rows)] {
            self.node("Integer", name, &format!("<Value>{most}</Value>"));
        }
        self.integer("Width", feature::WIDTH, "RW", "<Min>16</Min><pMax>WidthMax</pMax><Inc>4</Inc>");
        self.integer("Height", feature::HEIGHT, "RW", "<Min>2</Min><pMax>HeightMax</pMax><Inc>2</Inc>");
        self.integer("OffsetX", feature::OFFSET_X, "RW", "<Min>0</Min><pMax>OffsetXMax</pMax><Inc>4</Inc>");
        self.integer("OffsetY", feature::OFFSET_Y, "RW", "<Min>0</Min><pMax>OffsetYMax</pMax><Inc>2</Inc>");
        for (name, most, other) in [
            ("WidthMax", "SensorWidth", "OffsetX"),
            ("HeightMax", "SensorHeight", "OffsetY"),
            ("OffsetXMax", "SensorWidth", "Width"),
            ("OffsetYMax", "SensorHeight", "Height"),
        ] {
            let _ = writeln!(
                self.xml,
                "<IntSwissKnife Name=\"{name}\"><pVariable Name=\"MOST\">{most}</pVariable><pVariable Name=\"OTHER\">{other}Reg\
                 </pVariable><Formula>MOST - OTHER</Formula></IntSwissKnife>"
            );
        }
        let formats = FORMATS.map(|(name, code, _)| (name, code));
        self.choice("PixelFormat", feature::PIXEL_FORMAT, &formats, LOCKED);
        self.integer("PayloadSize", feature::PAYLOAD, "RO", "");
    }

    fn exposure(&mut self) {
        let automatic = [("Off", 0), ("Continuous", 2)];
        self.choice("ExposureAuto", feature::EXPOSURE_AUTO, &automatic, "");
        self.choice("GainAuto", feature::GAIN_AUTO, &automatic, "");
        // A number with a fraction before a whole one, as many makers have it.
        self.node("Float", "ExposureTime", "<pValue>ExposureTimeRaw</pValue><Unit>us</Unit>");
        self.integer("ExposureTimeRaw", feature::EXPOSURE_US, "RW", "<Min>10</Min><Max>1000000</Max>");
        self.node("Float", "Gain", "<pValue>GainConverter</pValue><Unit>dB</Unit>");
        self.xml += "<Converter Name=\"GainConverter\"><FormulaTo>FROM * 10</FormulaTo><FormulaFrom>TO / 10</FormulaFrom>\
                     <pValue>GainRaw</pValue><Slope>Increasing</Slope></Converter>\n";
        self.integer("GainRaw", feature::GAIN, "RW", "<Min>0</Min><Max>480</Max>");
        self.integer("BlackLevelRaw", feature::BLACK_LEVEL, "RW", "<Min>0</Min><Max>255</Max>");
        self.flag("GammaEnable", feature::GAMMA_ENABLE);
        self.node("Float", "DeviceTemperature", "<pValue>DeviceTemperatureReg</pValue><Unit>C</Unit>");
        self.register("FloatReg", "DeviceTemperature", feature::TEMPERATURE, "RO");
    }

    fn acquisition(&mut self) {
        self.node(
            "Enumeration",
            "AcquisitionMode",
            "<EnumEntry Name=\"Continuous\" NameSpace=\"Standard\"><Value>0</Value></EnumEntry><Value>0</Value>",
        );
        self.register("IntReg", "Acquire", feature::ACQUIRE, "WO");
        self.command("AcquisitionStart", "Acquire", 1);
        self.command("AcquisitionStop", "Acquire", 0);
        self.flag("AcquisitionFrameRateEnable", feature::RATE_ENABLE);
        self.node(
            "Float",
            "AcquisitionFrameRate",
            "<pValue>AcquisitionFrameRateReg</pValue><Min>0.1</Min><Max>1000</Max><Unit>Hz</Unit>",
        );
        self.register("FloatReg", "AcquisitionFrameRate", feature::RATE_HZ, "RW");
        self.node("Float", "ResultingFrameRate", "<pValue>ResultingFrameRateReg</pValue><Unit>Hz</Unit>");
        self.register("FloatReg", "ResultingFrameRate", feature::MOST_RATE_HZ, "RO");
        let limits = format!("<Min>1000000</Min><Max>{}</Max>", self.wire.most_bytes_s);
        self.integer("DeviceLinkThroughputLimit", feature::THROUGHPUT, "RW", &limits);
        self.node("Integer", "TLParamsLocked", "<pValue>TLParamsLockedReg</pValue><Min>0</Min><Max>1</Max>");
        self.register("IntReg", "TLParamsLocked", feature::LOCKED, "RW");
    }

    fn lines(&mut self) {
        let selectors = "<pSelected>TriggerMode</pSelected><pSelected>TriggerSource</pSelected>";
        self.node(
            "Enumeration",
            "TriggerSelector",
            &format!("<EnumEntry Name=\"FrameStart\" NameSpace=\"Standard\"><Value>0</Value></EnumEntry><Value>0</Value>{selectors}"),
        );
        self.choice("TriggerMode", feature::TRIGGER_MODE, &[("Off", 0), ("On", 1)], "");
        self.choice("TriggerSource", feature::TRIGGER_SOURCE, &[("Software", 0), ("Line0", 1), ("Line1", 2)], "");
        self.register("IntReg", "TriggerSoftware", feature::TRIGGER_SOFTWARE, "WO");
        self.command("TriggerSoftware", "TriggerSoftware", 1);
        let edges = [("RisingEdge", 0), ("FallingEdge", 1)];
        self.choice("TriggerActivation", feature::TRIGGER_ACTIVATION, &edges, "");
        self.choice("LineSelector", feature::LINE_SELECTOR, &[("Line0", 1), ("Line1", 2)], "");
        self.choice("LineMode", feature::LINE_MODE, &[("Input", 0), ("Output", 1)], "");
        self.choice("LineSource", feature::LINE_SOURCE, &[("Off", 0), ("ExposureActive", 1)], "");
    }

    fn chunks(&mut self) {
        self.flag("ChunkModeActive", feature::CHUNK_ACTIVE);
        let entries: Vec<(&str, u32)> = CHUNKS.iter().enumerate().map(|(at, (name, ..))| (*name, at as u32)).collect();
        self.choice("ChunkSelector", feature::CHUNK_SELECTOR, &entries, "<pSelected>ChunkEnable</pSelected>");
        self.node(
            "Boolean",
            "ChunkEnable",
            "<pValue>ChunkEnableReg</pValue><OnValue>1</OnValue><OffValue>0</OffValue>",
        );
        let _ = writeln!(
            self.xml,
            "<IntReg Name=\"ChunkEnableReg\"><Address>{:#x}</Address><pIndex Offset=\"4\">ChunkSelectorReg</pIndex><Length>4</Length>\
             <AccessMode>RW</AccessMode><pPort>Device</pPort><Cachable>NoCache</Cachable><Sign>Unsigned</Sign>\
             <Endianess>{}</Endianess></IntReg>",
            self.wire.features + u64::from(feature::CHUNK_ENABLE),
            self.order()
        );
        for (name, id, length) in CHUNKS {
            let kinds = if name == "ExposureTime" {
                ["Float", "FloatReg", ""]
            } else {
                ["Integer", "IntReg", "<Sign>Unsigned</Sign>"]
            };
            let [front, behind, sign] = kinds;
            let order = self.order();
            self.node(front, &format!("Chunk{name}"), &format!("<pValue>Chunk{name}Reg</pValue>"));
            let _ = writeln!(
                self.xml,
                "<{behind} Name=\"Chunk{name}Reg\"><Address>0</Address><Length>{length}</Length><AccessMode>RO</AccessMode>\
                 <pPort>Chunk{name}Port</pPort>{sign}<Endianess>{order}</Endianess></{behind}>\n\
                 <Port Name=\"Chunk{name}Port\"><ChunkID>{id:x}</ChunkID></Port>"
            );
        }
    }
}

/// What cannot be changed while the camera streams.
const LOCKED: &str = "<pIsLocked>TLParamsLockedReg</pIsLocked>";

/// A ZIP archive of one stored file.
pub(crate) fn archive(text: &str) -> Vec<u8> {
    let (text, name) = (text.as_bytes(), b"emulated.xml");
    let mut common = Vec::new();
    for half in [20_u16, 0, 0, 0, 0x5a21] {
        common.extend(half.to_le_bytes());
    }
    for word in [crc32fast::hash(text), text.len() as u32, text.len() as u32] {
        common.extend(word.to_le_bytes());
    }
    common.extend((name.len() as u16).to_le_bytes());
    common.extend([0, 0]);
    let mut zip = b"PK\x03\x04".to_vec();
    zip.extend(&common);
    zip.extend(name);
    zip.extend(text);
    let directory = zip.len() as u32;
    zip.extend(b"PK\x01\x02\x14\0");
    zip.extend(&common);
    zip.extend([0; 14]);
    zip.extend(name);
    let length = zip.len() as u32 - directory;
    zip.extend(b"PK\x05\x06\0\0\0\0\x01\0\x01\0");
    zip.extend(length.to_le_bytes());
    zip.extend(directory.to_le_bytes());
    zip.extend([0, 0]);
    zip
}
