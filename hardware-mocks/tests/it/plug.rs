//! Faults of transfers, and the account of what was delivered.

use erfgs_hardware_mocks::usb::{Fault, FaultKind, Faults, Plug, Reply, Speed, Urb, UsbDevice};

use super::host::Bench;

/// Counts: each transfer from 0x81 gives the next 8 bytes.
#[derive(Default)]
struct Counter(u8);

impl UsbDevice for Counter {
    fn speed(&self) -> Speed {
        Speed::High
    }

    fn submit(&mut self, urb: &Urb, _now_ns: i64) -> Reply {
        if urb.endpoint == 0 {
            return Reply::Taken(0);
        }
        self.0 += 8;
        Reply::Data((self.0 - 8..self.0).collect())
    }

    fn reset(&mut self) {
        self.0 = 0;
    }
}

fn plugged(kinds: Vec<FaultKind>) -> Bench<Plug<Counter>> {
    let schedule = kinds.into_iter().map(|kind| Fault { at_ms: 10, kind }).collect();
    let mut bench = Bench::new(Plug::new(Counter::default(), &Faults { schedule, ..Faults::default() }));
    assert_eq!(read(&mut bench), Reply::Data((0..8).collect()));
    bench.wait_us(10_000);
    bench
}

fn read(bench: &mut Bench<Plug<Counter>>) -> Reply {
    bench.submit(&Urb::bulk_in(0x81, 64))
}

#[test]
fn an_endpoint_that_naks_goes_on_later() {
    let mut bench = plugged(vec![FaultKind::Nak { endpoint: 0x81, for_ms: 5 }]);
    assert_eq!(read(&mut bench), Reply::Pending);
    bench.wait_us(4_999);
    assert_eq!(read(&mut bench), Reply::Pending);
    bench.wait_us(1);
    assert_eq!(read(&mut bench), Reply::Data((8..16).collect()));
}

#[test]
fn a_stalled_endpoint_waits_for_the_halt_to_be_cleared() {
    let mut bench = plugged(vec![FaultKind::Stall { endpoint: 0x81 }]);
    assert_eq!(read(&mut bench), Reply::Stall);
    bench.wait_us(1_000_000);
    assert_eq!(read(&mut bench), Reply::Stall);
    assert_eq!(bench.control_in(0x82, 0, 0, 0x81, 2), [1, 0]);
    bench.submit(&Urb::control_out(0x02, 1, 0, 0x81, &[]));
    assert_eq!(read(&mut bench), Reply::Data((8..16).collect()));
}

#[test]
fn a_short_read_keeps_or_loses_the_rest() {
    let mut bench = plugged(vec![FaultKind::ShortRead { endpoint: 0x81, bytes: 3, lost: false }]);
    assert_eq!(read(&mut bench), Reply::Data(vec![8, 9, 10]));
    assert_eq!(read(&mut bench), Reply::Data(vec![11, 12, 13, 14, 15]));
    let mut bench = plugged(vec![FaultKind::ShortRead { endpoint: 0x81, bytes: 3, lost: true }]);
    assert_eq!(read(&mut bench), Reply::Data(vec![8, 9, 10]));
    assert_eq!(read(&mut bench), Reply::Data((16..24).collect()));
}

#[test]
fn a_word_arrives_corrupt_and_a_transfer_not_at_all() {
    let mut bench = plugged(vec![
        FaultKind::CorruptWord { endpoint: 0x81, word: 1, bits: 0x8001 },
        FaultKind::LostTransfer { endpoint: 0x81 },
    ]);
    assert_eq!(read(&mut bench), Reply::Data(vec![8, 9, 11, 0x8b, 12, 13, 14, 15]));
    assert_eq!(read(&mut bench), Reply::Pending);
    assert_eq!(read(&mut bench), Reply::Data((24..32).collect()));
}

#[test]
fn a_device_leaves_the_bus_and_comes_back_freshly_powered() {
    let mut bench = plugged(vec![FaultKind::Unplug { for_ms: 100 }]);
    assert_eq!(read(&mut bench), Reply::Gone);
    assert!(!bench.device.plugged(bench.now_ns));
    bench.wait_us(100_000);
    assert!(bench.device.plugged(bench.now_ns));
    assert_eq!(read(&mut bench), Reply::Data((0..8).collect()));
    bench.device.unplug();
    assert_eq!(read(&mut bench), Reply::Gone);
    bench.wait_us(10_000_000);
    assert_eq!(read(&mut bench), Reply::Gone);
    bench.device.plug();
    assert_eq!(read(&mut bench), Reply::Data((0..8).collect()));
}

#[test]
fn the_ledger_accounts_for_every_byte_of_every_session() {
    let mut bench = plugged(vec![FaultKind::Unplug { for_ms: 1 }]);
    read(&mut bench);
    bench.wait_us(1_000);
    read(&mut bench);
    read(&mut bench);
    let ledger = bench.device.ledger();
    let ledger = ledger.lock();
    let bytes: Vec<u64> = ledger.sessions.iter().map(|session| session[&0x81].bytes).collect();
    assert_eq!(bytes, [8, 16]);
    assert_eq!(ledger.sessions[1][&0x81].transfers, 2);
    let all: Vec<u8> = (0..16).collect();
    // The CRC-32 of zlib over 0, 1, ... 15.
    assert_eq!(ledger.sessions[1][&0x81].crc32, crc32(&all));
}

fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0, |crc: u32, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |crc, _| crc >> 1 ^ (0xedb8_8320 & (crc & 1).wrapping_neg()))
    })
}
