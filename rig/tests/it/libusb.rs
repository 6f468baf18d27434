//! The real bus of this machine, whatever is plugged in.

use erfgs_rig::usb::{Bus, Fault, Identity, LibusbBus, Speed};

#[test]
fn a_device_that_is_not_there_is_gone() {
    let absent = Identity {
        vendor: 0xFFFF,
        product: 0xFFFF,
        version: 0,
        bus: 255,
        address: 255,
        port: "255-1".into(),
        speed: Speed::Super,
    };
    assert!(!LibusbBus.list().unwrap().contains(&absent));
    let error = LibusbBus.open(&absent).err().unwrap();
    assert_eq!(error.fault, Fault::Gone);
    assert!(error.to_string().contains("ffff:ffff at 255:255 (port 255-1)"), "{error}");
}
