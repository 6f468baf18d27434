//! Descriptors, and the requests that every USB device answers (USB 2.0 chapter 9, USB 3.2 chapter 9).

use std::collections::{BTreeMap, BTreeSet};

use super::{Reply, Setup, Speed};

/// US English, the one language of the strings.
const LANGUAGE: u16 = 0x0409;

/// What a device says of itself.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Descriptors {
    /// The device descriptor.
    pub device: [u8; 18],
    /// The configuration descriptor with everything that belongs to it.
    pub configuration: Vec<u8>,
    /// The binary object store of a SuperSpeed device.
    pub bos: Option<Vec<u8>>,
    /// String descriptors 1, 2, ...
    pub strings: Vec<String>,
}

/// The identity in a device descriptor. Strings 1 to 3 are maker, product and serial number; an empty one is left out.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Identity {
    /// Vendor.
    pub vendor: u16,
    /// Product.
    pub product: u16,
    /// Release of the device, binary-coded decimal.
    pub release: u16,
    /// Class, subclass, protocol.
    pub class: [u8; 3],
    /// The maker's name.
    pub maker: String,
    /// The product's name.
    pub name: String,
    /// The serial number.
    pub serial: String,
}

impl Identity {
    /// The descriptors of a device with this identity and one configuration, whose interfaces are given as they follow
    /// the configuration descriptor.
    #[must_use]
    pub fn with_interfaces(&self, speed: Speed, interfaces: u8, body: &[u8]) -> Descriptors {
        let (version, packet) = match speed {
            Speed::High => (0x0200_u16, 64),
            Speed::Super => (0x0300, 9),
        };
        let strings = vec![self.maker.clone(), self.name.clone(), self.serial.clone()];
        let index = |number: u8| if strings[usize::from(number) - 1].is_empty() { 0 } else { number };
        let mut device =
            [18, 1, 0, 0, self.class[0], self.class[1], self.class[2], packet, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1];
        device[2..4].copy_from_slice(&version.to_le_bytes());
        device[8..10].copy_from_slice(&self.vendor.to_le_bytes());
        device[10..12].copy_from_slice(&self.product.to_le_bytes());
        device[12..14].copy_from_slice(&self.release.to_le_bytes());
        device[14..17].copy_from_slice(&[index(1), index(2), index(3)]);
        let total = (9 + body.len()) as u16;
        let [low, high] = total.to_le_bytes();
        let mut configuration = vec![9, 2, low, high, interfaces, 1, 0, 0x80, 100];
        configuration.extend_from_slice(body);
        let bos = (speed == Speed::Super).then(|| {
            // USB 2.0 extension (link power management off), then SuperSpeed capabilities: full, high and super speed.
            vec![5, 15, 22, 0, 2, 7, 16, 2, 0, 0, 0, 0, 10, 16, 3, 0, 0x0e, 0, 3, 10, 0xff, 7]
        });
        Descriptors { device, configuration, bos, strings }
    }
}

/// An interface descriptor.
#[must_use]
pub fn interface(number: u8, alternate: u8, endpoints: u8, class: [u8; 3]) -> Vec<u8> {
    vec![9, 4, number, alternate, endpoints, class[0], class[1], class[2], 0]
}

/// The descriptor of a bulk endpoint, followed by its companion at SuperSpeed.
#[must_use]
pub fn bulk_endpoint(speed: Speed, address: u8) -> Vec<u8> {
    match speed {
        Speed::High => vec![7, 5, address, 2, 0x00, 0x02, 0],
        Speed::Super => vec![7, 5, address, 2, 0x00, 0x04, 0, 6, 48, 15, 0, 0, 0],
    }
}

/// The descriptor of an interrupt endpoint of 64-byte packets every 8 ms, followed by its companion at SuperSpeed.
#[must_use]
pub fn interrupt_endpoint(speed: Speed, address: u8) -> Vec<u8> {
    let mut bytes = vec![7, 5, address, 3, 64, 0, 7];
    if speed == Speed::Super {
        bytes.extend([6, 48, 0, 0, 64, 0]);
    }
    bytes
}

/// Answers the standard requests, and keeps the state that they set.
#[derive(Clone, Debug)]
pub struct Standard {
    descriptors: Descriptors,
    configuration: u8,
    alternates: BTreeMap<u8, u8>,
    halted: BTreeSet<u8>,
}

impl Standard {
    /// An unconfigured device.
    #[must_use]
    pub fn new(descriptors: Descriptors) -> Self {
        Self { descriptors, configuration: 0, alternates: BTreeMap::new(), halted: BTreeSet::new() }
    }

    /// The state after power-on.
    pub fn reset(&mut self) {
        self.configuration = 0;
        self.alternates.clear();
        self.halted.clear();
    }

    /// Whether an endpoint is halted.
    #[must_use]
    pub fn is_halted(&self, endpoint: u8) -> bool {
        self.halted.contains(&endpoint)
    }

    /// Answers a standard request; `None` for class and vendor requests. `taken` is how much data came with it.
    pub fn answer(&mut self, setup: &Setup, taken: usize) -> Option<Reply> {
        if setup.request_type & 0x60 != 0 {
            return None;
        }
        let [low, high] = setup.value.to_le_bytes();
        let endpoint = setup.index.to_le_bytes()[0];
        let data = |bytes: &[u8]| Some(Reply::Data(bytes[..bytes.len().min(usize::from(setup.length))].to_vec()));
        match (setup.request_type, setup.request) {
            (0x80 | 0x81, 6) => self.descriptor(high, low).map_or(Some(Reply::Stall), |bytes| data(&bytes)),
            (0x80 | 0x81, 0) => data(&[0, 0]),
            (0x82, 0) => data(&[u8::from(self.is_halted(endpoint)), 0]),
            (0x80, 8) => data(&[self.configuration]),
            (0x81, 10) => data(&[self.alternates.get(&endpoint).copied().unwrap_or(0)]),
            (0x00, 9) if low <= 1 => {
                self.configuration = low;
                self.halted.clear();
                Some(Reply::Taken(0))
            }
            (0x01, 11) => {
                self.alternates.insert(endpoint, low);
                Some(Reply::Taken(0))
            }
            (0x02, 1) if setup.value == 0 => {
                self.halted.remove(&endpoint);
                Some(Reply::Taken(0))
            }
            (0x02, 3) if setup.value == 0 => {
                self.halted.insert(endpoint);
                Some(Reply::Taken(0))
            }
            // Features of power management, address, system exit latency, isochronous delay: nothing to do.
            (0x00..=0x02, 1 | 3 | 5 | 48 | 49) => Some(Reply::Taken(taken)),
            _ => Some(Reply::Stall),
        }
    }

    fn descriptor(&self, kind: u8, index: u8) -> Option<Vec<u8>> {
        match kind {
            1 => Some(self.descriptors.device.to_vec()),
            2 if index == 0 => Some(self.descriptors.configuration.clone()),
            3 if index == 0 => Some([&[4, 3][..], &LANGUAGE.to_le_bytes()].concat()),
            3 => {
                let text = self.descriptors.strings.get(usize::from(index) - 1).filter(|text| !text.is_empty())?;
                let units: Vec<u8> = text.encode_utf16().take(126).flat_map(u16::to_le_bytes).collect();
                Some([&[2 + units.len() as u8, 3][..], &units].concat())
            }
            15 => self.descriptors.bos.clone(),
            _ => None,
        }
    }
}
