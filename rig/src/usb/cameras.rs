//! Which devices on a bus are cameras that keep transfers in flight, by what the bus shows of them. All of them share the memory that
//! the kernel has for that, whichever driver opens them.

use super::{Bus, Identity, Interface};

/// Class, subclass and protocol of the interface that controls a USB3 Vision camera.
const U3V_CONTROL: (u8, u8, u8) = (0xef, 5, 0);

/// Whether the identifiers are those of a Prophesee board, or of a camera with the same board.
pub(crate) fn is_prophesee(identity: &Identity) -> bool {
    matches!((identity.vendor, identity.product), (0x04b4, 0x00f4 | 0x00f5) | (0x31f7, 0x0003) | (0x1409, 0x8e00))
}

/// Whether the identifiers are those of a DAVIS346.
pub(crate) fn is_davis346(identity: &Identity) -> bool {
    (identity.vendor, identity.product) == (0x152a, 0x841a)
}

/// The interface that controls a USB3 Vision camera, if these are of one.
pub(crate) fn u3v_control(interfaces: &[Interface]) -> Option<&Interface> {
    interfaces.iter().find(|interface| interface.class == U3V_CONTROL)
}

/// How many cameras on a bus share the memory, one at least.
pub(super) fn count(bus: &dyn Bus) -> usize {
    let is_one = |identity: &&Identity| {
        is_prophesee(identity)
            || is_davis346(identity)
            || bus.describe(identity).is_ok_and(|described| u3v_control(&described.interfaces).is_some())
    };
    bus.list().unwrap_or_default().iter().filter(is_one).count().max(1)
}
