//! GigE Vision cameras: listed, chosen, and as a link.

use std::{collections::VecDeque, net::Ipv4Addr, sync::Arc, time::Duration};

use serde_json::{Map, Value, json};

use super::{
    choose::{Named, choose},
    link::{Device, Identity, Intake, Link},
};
use crate::{
    frame::{FoundCamera, FrameConfig, FrameError},
    genicam::{
        Block, Features, GenicamConfig, GenicamError, Order,
        gige::{self, Channel, Found, Pulse, Stream, gvsp::Receiver},
    },
    host_time::host_ns,
    not_applied::NotApplied,
};

/// So many blocks in a row of which the leader came and no payload are no accident.
const LEADERS_ALONE: u32 = 3;

/// The GigE Vision cameras of this machine's networks, and at some addresses beside.
///
/// # Errors
/// If the networks cannot be searched.
pub fn list(addresses: &[Ipv4Addr]) -> Result<Vec<FoundCamera>, FrameError> {
    let found = gige::find(addresses).map_err(|error| FrameError::List { reason: error.to_string() })?;
    Ok(found.iter().map(listed).collect())
}

fn listed(found: &Found) -> FoundCamera {
    let identity = &found.identity;
    let named = if identity.name.is_empty() { String::new() } else { format!(" \"{}\"", identity.name) };
    FoundCamera {
        name: format!("{}{named}", identity.label()),
        serial: identity.serial.clone(),
        bus: identity.address.to_string(),
        node: identity.mac_text().into(),
        driver: "gige".into(),
        formats: Vec::new(),
        link: None,
        problem: found.wrong_subnet().or_else(|| found.in_use()),
    }
}

/// The networks of this machine.
pub struct GigeLink;

impl Link for GigeLink {
    const BACKEND: &'static str = "gige";
    const ORDER: Order = Order::Big;
    type Device = GigeDevice;

    fn open(&self, config: &FrameConfig) -> Result<GigeDevice, FrameError> {
        let fail = |camera: String| {
            |source: GenicamError| FrameError::Genicam { id: config.id.clone(), camera, source: source.into() }
        };
        let wanted = config.camera.as_str();
        let more = config.genicam.clone().unwrap_or_default();
        let mut addresses = more.addresses.clone();
        // An address may lie where broadcasts do not come.
        addresses.extend(wanted.parse::<Ipv4Addr>());
        let found = gige::find(&addresses).map_err(fail(wanted.to_owned()))?;
        let found = choose(&config.id, wanted, found)?;
        let device = gige::Device::open(&found, &more).map_err(fail(identity(&found).full()))?;
        Ok(GigeDevice { found, device })
    }
}

impl Named for Found {
    const KIND: &'static str = "GigE Vision camera";
    const NONE: &'static str = "no GigE Vision camera answers; behind a router name it by its address";

    fn names(&self) -> [String; 5] {
        let identity = &self.identity;
        let (address, mac) = (identity.address.to_string(), identity.mac_text());
        [identity.serial.clone(), address, mac, identity.name.clone(), identity.label()]
    }

    fn description(&self) -> String {
        let identity = &self.identity;
        format!("{} (serial {}, at {})", identity.label(), identity.serial, identity.address)
    }
}

fn identity(found: &Found) -> Identity {
    Identity {
        label: found.identity.label(),
        serial: found.identity.serial.clone(),
        place: found.identity.address.to_string(),
        lasting: found.identity.mac_text(),
    }
}

/// A camera under control.
pub struct GigeDevice {
    found: Found,
    device: gige::Device,
}

impl Device for GigeDevice {
    type Intake = GigeIntake;

    fn identity(&self) -> Identity {
        identity(&self.found)
    }

    fn features(&mut self) -> &mut Features {
        &mut self.device.features
    }

    fn tick_hz(&self) -> u64 {
        self.device.tick_hz
    }

    fn lost(&self) -> Option<String> {
        self.device.lost()
    }

    fn prepare(&self, config: &GenicamConfig, frame_bytes: usize) -> Result<GigeIntake, GenicamError> {
        let stream = self.device.prepare(config, frame_bytes)?;
        Ok(GigeIntake {
            receiver: Receiver::new(stream.plan),
            dropped: stream.socket.dropped(),
            stream,
            channel: Arc::clone(&self.device.channel),
            pulse: self.device.pulse(),
            leaders_alone: 0,
            warnings: VecDeque::new(),
        })
    }

    fn tell(
        &self,
        intake: &GigeIntake,
        config: &GenicamConfig,
        settings: &mut Map<String, Value>,
        missed: &mut NotApplied,
    ) {
        let (identity, stream) = (&self.found.identity, &intake.stream);
        let link_settings = json!({
            "address": identity.address.to_string(),
            "mac": identity.mac_text(),
            "user_name": identity.name,
            "packet_bytes": stream.packet_bytes,
            "resend": stream.plan.resend,
            "receive_buffer_bytes": stream.socket.room_bytes(),
        });
        if let Value::Object(link_settings) = link_settings {
            settings.extend(link_settings);
        }
        if let Some(asked) = config.packet_bytes {
            missed.compare("genicam.packet_bytes", asked, stream.packet_bytes);
        }
        if config.resend && !stream.plan.resend {
            missed.because("genicam.resend = true", "the camera keeps no packets");
        }
        let (room, wanted) = (stream.socket.room_bytes(), stream.wanted_room);
        if room < wanted {
            missed.because(
                &format!("genicam.receive_buffer_mib = {}", wanted.div_ceil(1 << 20)),
                format!(
                    "the system gives {:.1}; packets are lost when this program has to wait. `sudo sysctl -w \
                     net.core.rmem_max={wanted}` raises its limit",
                    room as f64 / f64::from(1 << 20)
                ),
            );
        }
    }

    fn begin(&mut self, intake: &mut GigeIntake) -> Result<(), GenicamError> {
        self.device.begin(&mut intake.stream)?;
        intake.receiver = Receiver::new(intake.stream.plan);
        intake.dropped = intake.stream.socket.dropped();
        intake.leaders_alone = 0;
        Ok(())
    }

    fn end(&mut self, _intake: &mut GigeIntake) -> Result<(), GenicamError> {
        self.device.end()
    }
}

/// A socket, and what puts its datagrams together.
pub struct GigeIntake {
    stream: Stream,
    receiver: Receiver,
    channel: Arc<Channel>,
    pulse: Pulse,
    leaders_alone: u32,
    dropped: u32,
    warnings: VecDeque<String>,
}

impl GigeIntake {
    /// Whether frames begin and their pixels do not come.
    fn look(&mut self, block: &Block) {
        let packets = self.stream.plan.block_bytes.div_ceil(self.stream.plan.datagram_bytes.max(1)) as u32;
        let alone = block.leader.is_some() && block.missing >= packets.max(2);
        self.leaders_alone = if alone { self.leaders_alone + 1 } else { 0 };
        if self.leaders_alone == LEADERS_ALONE {
            let bytes = self.stream.packet_bytes;
            self.warnings.push_back(format!(
                "frames begin and their pixels do not come: packets of {bytes} bytes are dropped on the way. Set \
                 genicam.packet_bytes = 1500, or let every switch and interface pass jumbo frames"
            ));
        }
    }
}

impl Intake for GigeIntake {
    fn receive(&mut self, wait: Duration) -> Result<(), String> {
        let wait = self
            .receiver
            .wake_ns()
            .map_or(wait, |wake_ns| Duration::from_nanos(u64::try_from(wake_ns - host_ns()).unwrap_or(0)).min(wait));
        let receiver = &mut self.receiver;
        let received = self.stream.socket.receive(wait, |bytes, now_ns| receiver.take(bytes, now_ns));
        received.map_err(|error| error.to_string())?;
        self.receiver.advance(host_ns());
        while let Some(request) = self.receiver.next_request() {
            self.channel.ask_again(&request);
        }
        let dropped = self.stream.socket.dropped();
        if dropped != self.dropped {
            let room = self.stream.socket.room_bytes() >> 10;
            self.dropped = dropped;
            self.warnings.push_back(format!(
                "the kernel had no room for packets of its stream ({room} KiB): raise it by `sudo sysctl -w \
                 net.core.rmem_max=67108864` and genicam.receive_buffer_mib = 64, and see what else keeps this machine busy"
            ));
        }
        Ok(())
    }

    fn lost(&mut self) -> Option<String> {
        self.pulse.lost()
    }

    fn next_block(&mut self) -> Option<Block> {
        let block = self.receiver.next_block()?;
        self.look(&block);
        Some(block)
    }

    fn warning(&mut self) -> Option<String> {
        self.warnings.pop_front()
    }

    fn end(&mut self) {
        self.receiver.end();
    }

    fn is_busy(&self) -> bool {
        self.receiver.is_busy()
    }

    fn finish(&mut self) {
        self.receiver.finish();
    }

    fn lost_blocks(&self) -> u64 {
        self.receiver.counts().lost
    }

    fn counts(&self, into: &mut Vec<(&'static str, u64)>) {
        let counts = self.receiver.counts();
        into.extend([
            ("missing_packets", counts.missing),
            ("asked_packets", counts.asked),
            ("late_packets", counts.late),
            ("doubled_packets", counts.doubled),
            ("strange_packets", counts.strange),
            ("kernel_drops", self.dropped.into()),
        ]);
    }

    fn silence(&self) -> &'static str {
        "a firewall of this machine may drop its stream (UDP from the camera), or its packets are too large for a switch \
         (genicam.packet_bytes = 1500)"
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::genicam::gige::{Reach, gvcp};

    fn camera(number: u8, serial: &str, name: &str) -> Found {
        let identity = gvcp::Identity {
            mac: [2, 0, 0, 0, 0, number],
            address: [192, 168, 1, number].into(),
            mask: [255, 255, 255, 0].into(),
            maker: "Maker".into(),
            model: "M1".into(),
            serial: serial.into(),
            name: name.into(),
        };
        Found { identity, reach: Reach::From([192, 168, 1, 200].into()) }
    }

    #[test]
    fn a_camera_is_meant_by_serial_number_address_hardware_address_or_name() {
        let both = || vec![camera(1, "A1", "left"), camera(2, "B2", "right")];
        for (wanted, serial) in [("A1", "A1"), ("192.168.1.2", "B2"), ("02:00:00:00:00:01", "A1"), ("right", "B2")] {
            assert_eq!(choose("x", wanted, both()).unwrap().identity.serial, serial);
        }
        let error = |wanted| choose("x", wanted, both()).unwrap_err().to_string();
        assert!(
            error("Maker M1").contains("several are \"Maker M1\"") && error("C3").contains("serial B2, at 192.168.1.2")
        );
        assert!(error("").contains("name one as `camera`"));
        assert!(choose::<Found>("x", "", Vec::new()).unwrap_err().to_string().contains("behind a router"));
        assert_eq!(choose("x", "", vec![camera(3, "", "")]).unwrap().identity.mac[5], 3);
    }
}
