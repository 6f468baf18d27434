//! Real devices, through libusb (crate rusb).

use std::{sync::Arc, time::Duration};

use rusb::UsbContext;

use super::{
    Bus, Control, Described, Endpoint, Fault, Flight, Identity, Interface, Receiver, Speed, Stream, Transport,
    TransportError, asynchronous::BulkStream,
};

/// The devices of this machine.
#[derive(Clone, Copy, Debug, Default)]
pub struct LibusbBus;

fn identity_of(device: &rusb::Device<rusb::Context>) -> rusb::Result<Identity> {
    let descriptor = device.device_descriptor()?;
    let version = descriptor.device_version();
    let ports = device.port_numbers().unwrap_or_default();
    let port = match ports.split_first() {
        None => format!("usb{}", device.bus_number()),
        Some((first, rest)) => {
            rest.iter().fold(format!("{}-{first}", device.bus_number()), |path, port| format!("{path}.{port}"))
        }
    };
    Ok(Identity {
        vendor: descriptor.vendor_id(),
        product: descriptor.product_id(),
        version: u16::from(version.major()) << 8 | u16::from(version.minor()) << 4 | u16::from(version.sub_minor()),
        bus: device.bus_number(),
        address: device.address(),
        port,
        speed: match device.speed() {
            rusb::Speed::Low | rusb::Speed::Full => Speed::Full,
            rusb::Speed::High => Speed::High,
            rusb::Speed::Super | rusb::Speed::SuperPlus => Speed::Super,
            _ => Speed::Unknown,
        },
    })
}

fn interfaces_of(device: &rusb::Device<rusb::Context>) -> rusb::Result<Vec<Interface>> {
    let configuration = device.active_config_descriptor().or_else(|_| device.config_descriptor(0))?;
    Ok(configuration
        .interfaces()
        .filter_map(|interface| {
            let setting = interface.descriptors().find(|setting| setting.setting_number() == 0)?;
            Some(Interface {
                number: interface.number(),
                class: (setting.class_code(), setting.sub_class_code(), setting.protocol_code()),
                endpoints: setting
                    .endpoint_descriptors()
                    .map(|endpoint| Endpoint {
                        address: endpoint.address(),
                        bulk: endpoint.transfer_type() == rusb::TransferType::Bulk,
                    })
                    .collect(),
            })
        })
        .collect())
}

fn failed(identity: &Identity, step: &str, error: rusb::Error) -> TransportError {
    TransportError::new(identity, step, Fault::of_rusb(error, identity))
}

/// A device that was listed, in a context of its own: the events of one camera are never handled by another's thread.
fn find(identity: &Identity) -> Result<rusb::Device<rusb::Context>, TransportError> {
    let context = rusb::Context::new().map_err(|error| failed(identity, "start libusb", error))?;
    let devices = context.devices().map_err(|error| failed(identity, "list the devices", error))?;
    let mut all = devices.iter();
    all.find(|device| identity_of(device).is_ok_and(|found| found == *identity))
        .ok_or_else(|| TransportError::new(identity, "open", Fault::Gone))
}

/// What Linux knows of a device; empty where it does not, and on other systems.
fn attribute(identity: &Identity, name: &str) -> String {
    let path = format!("/sys/bus/usb/devices/{}/{name}", identity.port);
    std::fs::read_to_string(path).map(|text| text.trim().to_owned()).unwrap_or_default()
}

fn whole_bus(step: &str, error: rusb::Error) -> TransportError {
    TransportError {
        device: "(all)".into(),
        step: step.into(),
        fault: match error {
            rusb::Error::NoMem => Fault::Memory(super::budget::memory_advice()),
            _ => Fault::Io(libusb1_sys::constants::LIBUSB_ERROR_OTHER),
        },
    }
}

impl Bus for LibusbBus {
    fn list(&self) -> Result<Vec<Identity>, TransportError> {
        let context = rusb::Context::new().map_err(|error| whole_bus("start libusb", error))?;
        let devices = context.devices().map_err(|error| whole_bus("list the devices", error))?;
        Ok(devices.iter().filter_map(|device| identity_of(&device).ok()).collect())
    }

    fn describe(&self, identity: &Identity) -> Result<Described, TransportError> {
        let device = find(identity)?;
        let interfaces = interfaces_of(&device).map_err(|error| failed(identity, "read its descriptors", error))?;
        let [maker, product, serial] = ["manufacturer", "product", "serial"].map(|name| attribute(identity, name));
        Ok(Described { interfaces, maker, product, serial })
    }

    fn open(&self, identity: &Identity) -> Result<Arc<dyn Transport>, TransportError> {
        let failed = |step: &str, error| failed(identity, step, error);
        let device = find(identity)?;
        let interfaces = interfaces_of(&device).map_err(|error| failed("read its descriptors", error))?;
        let handle = device.open().map_err(|error| failed("open", error))?;
        match handle.set_auto_detach_kernel_driver(true) {
            Ok(()) | Err(rusb::Error::NotSupported) => {}
            Err(error) => return Err(failed("detach the kernel's driver", error)),
        }
        let serial = device
            .device_descriptor()
            .ok()
            .and_then(|descriptor| handle.read_serial_number_string_ascii(&descriptor).ok())
            .map(|serial| serial.trim_end_matches('\0').trim().to_owned())
            .filter(|serial| !serial.is_empty());
        Ok(Arc::new(LibusbTransport { handle: Arc::new(handle), identity: identity.clone(), serial, interfaces }))
    }
}

/// A device opened through libusb.
struct LibusbTransport {
    handle: Arc<rusb::DeviceHandle<rusb::Context>>,
    identity: Identity,
    serial: Option<String>,
    interfaces: Vec<Interface>,
}

impl LibusbTransport {
    fn done<T>(&self, result: rusb::Result<T>, step: impl FnOnce() -> String) -> Result<T, TransportError> {
        result.map_err(|error| TransportError::new(&self.identity, step(), Fault::of_rusb(error, &self.identity)))
    }
}

fn name(control: Control) -> String {
    format!("control request {:#04x} (value {:#06x}, index {:#06x})", control.request, control.value, control.index)
}

impl Transport for LibusbTransport {
    fn identity(&self) -> &Identity {
        &self.identity
    }

    fn serial(&self) -> Option<&str> {
        self.serial.as_deref()
    }

    fn interfaces(&self) -> &[Interface] {
        &self.interfaces
    }

    fn claim(&self, interface: u8, select: bool) -> Result<(), TransportError> {
        self.done(self.handle.claim_interface(interface), || format!("claim interface {interface}"))?;
        if select {
            self.done(self.handle.set_alternate_setting(interface, 0), || {
                format!("select alternate setting 0 of interface {interface}")
            })?;
        }
        Ok(())
    }

    fn control_read(&self, control: Control, into: &mut [u8], timeout: Duration) -> Result<usize, TransportError> {
        let Control { request_type, request, value, index } = control;
        self.done(self.handle.read_control(request_type, request, value, index, into, timeout), || name(control))
    }

    fn control_write(&self, control: Control, from: &[u8], timeout: Duration) -> Result<usize, TransportError> {
        let Control { request_type, request, value, index } = control;
        self.done(self.handle.write_control(request_type, request, value, index, from, timeout), || name(control))
    }

    fn bulk_read(&self, endpoint: u8, into: &mut [u8], timeout: Duration) -> Result<usize, TransportError> {
        self.done(self.handle.read_bulk(endpoint, into, timeout), || format!("read from endpoint {endpoint:#04x}"))
    }

    fn bulk_write(&self, endpoint: u8, from: &[u8], timeout: Duration) -> Result<usize, TransportError> {
        self.done(self.handle.write_bulk(endpoint, from, timeout), || format!("write to endpoint {endpoint:#04x}"))
    }

    fn clear_halt(&self, endpoint: u8) -> Result<(), TransportError> {
        self.done(self.handle.clear_halt(endpoint), || format!("end the halt of endpoint {endpoint:#04x}"))
    }

    fn stream(&self, endpoint: u8, flight: Flight, receiver: Receiver) -> Result<Box<dyn Stream>, TransportError> {
        let stream = BulkStream::open(Arc::clone(&self.handle), &self.identity, endpoint, flight, receiver)?;
        Ok(Box::new(stream))
    }
}
