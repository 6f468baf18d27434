//! The host's side, written from the protocol: no driver of ours is used.

use erfgs_hardware_mocks::usb::{Reply, Urb, UsbDevice};

/// A device on a bench with a clock that only moves when told to.
pub struct Bench<D> {
    pub device: D,
    pub now_ns: i64,
}

impl<D: UsbDevice> Bench<D> {
    pub fn new(device: D) -> Self {
        Self { device, now_ns: 1_000_000_000 }
    }

    pub fn wait_us(&mut self, us: i64) {
        self.now_ns += us * 1000;
    }

    pub fn submit(&mut self, urb: &Urb) -> Reply {
        self.device.submit(urb, self.now_ns)
    }

    pub fn control_in(&mut self, request_type: u8, request: u8, value: u16, index: u16, length: u16) -> Vec<u8> {
        match self.submit(&Urb::control_in(request_type, request, value, index, length)) {
            Reply::Data(data) => data,
            other => panic!("request {request:#x}, value {value:#x}, index {index:#x}: {other:?}"),
        }
    }

    /// Everything that `endpoint` has now.
    pub fn drain(&mut self, endpoint: u8, length: usize) -> Vec<u8> {
        let mut all = Vec::new();
        loop {
            match self.submit(&Urb::bulk_in(endpoint, length)) {
                Reply::Data(data) => all.extend(data),
                Reply::Pending => return all,
                other => panic!("endpoint {endpoint:#x}: {other:?}"),
            }
        }
    }

    /// Reads for a while, a transfer each millisecond at least.
    pub fn listen(&mut self, endpoint: u8, length: usize, for_us: i64) -> Vec<u8> {
        let mut all = Vec::new();
        let end = self.now_ns + for_us * 1000;
        while self.now_ns < end {
            self.now_ns = (self.now_ns + 1_000_000).min(end);
            all.extend(self.drain(endpoint, length));
        }
        all
    }
}

pub fn words(bytes: &[u8]) -> Vec<u16> {
    assert!(bytes.len().is_multiple_of(2));
    bytes.chunks(2).map(|word| u16::from_le_bytes([word[0], word[1]])).collect()
}
