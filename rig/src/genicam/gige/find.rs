//! The search for cameras: a broadcast from each interface, answered from whatever subnet a camera thinks that it is in.

use std::{
    io,
    net::{Ipv4Addr, SocketAddrV4, UdpSocket},
    time::{Duration, Instant},
};

use nix::sys::socket::{setsockopt, sockopt::BindToDevice};

use super::{
    gvcp::{self, Command, Identity, register},
    socket::Channel,
};
use crate::genicam::GenicamError;

/// How long cameras have to answer.
const PATIENCE: Duration = Duration::from_millis(400);
const LOOK_EVERY: Duration = Duration::from_millis(5);
/// The search is repeated once: a datagram may be lost.
const ASK_AGAIN: Duration = Duration::from_millis(150);
const ID: u16 = 0xe5f1;

/// An interface with an address.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Interface {
    /// Its name.
    pub name: String,
    /// Its address.
    pub address: Ipv4Addr,
    /// The mask of its subnet.
    pub mask: Ipv4Addr,
}

impl Interface {
    /// Whether an address lies in its subnet.
    #[must_use]
    pub fn reaches(&self, address: Ipv4Addr) -> bool {
        let mask = self.mask.to_bits();
        self.address.to_bits() & mask == address.to_bits() & mask
    }

    fn broadcast(&self) -> Ipv4Addr {
        Ipv4Addr::from_bits(self.address.to_bits() | !self.mask.to_bits())
    }

    fn subnet(&self) -> String {
        format!("{}/{}", self.address, self.mask.to_bits().count_ones())
    }
}

/// The interfaces of this machine that are up and have an address; not the loopback one.
///
/// # Errors
/// If the system does not list them.
pub fn interfaces() -> Result<Vec<Interface>, GenicamError> {
    use nix::net::if_::InterfaceFlags;
    let failed = |error: nix::errno::Errno| GenicamError::Network {
        doing: "list the network interfaces".into(),
        source: error.into(),
    };
    let all = nix::ifaddrs::getifaddrs().map_err(failed)?;
    let usable = all.filter(|entry| {
        entry.flags.contains(InterfaceFlags::IFF_UP) && !entry.flags.contains(InterfaceFlags::IFF_LOOPBACK)
    });
    let named = usable.filter_map(|entry| {
        let address = entry.address?.as_sockaddr_in()?.ip();
        let mask = entry.netmask?.as_sockaddr_in()?.ip();
        Some(Interface { name: entry.interface_name, address, mask })
    });
    Ok(named.collect())
}

/// Where to ask.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Target {
    /// All that is on the wire of an interface.
    Wire(Interface),
    /// One address, which may be behind routers, or a broadcast of a subnet.
    Address(Ipv4Addr),
}

/// A camera that answered.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Found {
    /// What it says of itself.
    pub identity: Identity,
    /// Where it can be spoken to: its address, or, where that lies in another subnet, nowhere.
    pub reach: Reach,
}

/// How a camera can be reached.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Reach {
    /// From this address of this machine (unspecified where the system's routes decide).
    From(Ipv4Addr),
    /// It is on the wire of an interface, with an address of another subnet.
    WrongSubnet(Interface),
}

impl Found {
    /// Why it cannot be used and what to do, if its address is the reason.
    #[must_use]
    pub fn wrong_subnet(&self) -> Option<String> {
        let Reach::WrongSubnet(interface) = &self.reach else { return None };
        let Identity { address, mask, .. } = self.identity;
        Some(format!(
            "it has the address {address}/{}, which {} ({}) does not reach: give the camera an address of that subnet with \
             its maker's program, or the interface one of the camera's: `sudo ip addr add {}/{} dev {}`",
            mask.to_bits().count_ones(),
            interface.name,
            interface.subnet(),
            neighbour(address),
            mask.to_bits().count_ones(),
            interface.name
        ))
    }

    /// Why it cannot be used now, if another program controls it: what to do. Asks the camera.
    #[must_use]
    pub fn in_use(&self) -> Option<String> {
        let Reach::From(own) = self.reach else { return None };
        let channel = Channel::open(self.identity.address, own).ok()?;
        let by = match channel.register(register::PRIVILEGE) {
            Ok(privilege) if privilege & (register::CONTROL | register::EXCLUSIVE) == 0 => return None,
            Ok(_) => controller(&channel),
            Err(GenicamError::Refused { .. }) => None,
            Err(error) => return Some(error.to_string()),
        };
        let seconds = channel.register(register::HEARTBEAT_MS).map_or(3.0, |ms| f64::from(ms) / 1000.0);
        Some(GenicamError::Held { by, seconds }.to_string())
    }
}

/// The address of the program that controls a camera, if it tells.
pub(super) fn controller(channel: &Channel) -> Option<Ipv4Addr> {
    channel.register(register::CONTROLLER).ok().map(Ipv4Addr::from_bits).filter(|address| !address.is_unspecified())
}

/// Another address of the same subnet.
fn neighbour(address: Ipv4Addr) -> Ipv4Addr {
    let [a, b, c, d] = address.octets();
    Ipv4Addr::new(a, b, c, if d < 250 { d + 1 } else { d - 1 })
}

/// The cameras on all wires of this machine, and at some addresses.
///
/// # Errors
/// If the system lists no interfaces or gives no sockets.
pub fn find(addresses: &[Ipv4Addr]) -> Result<Vec<Found>, GenicamError> {
    let wires = interfaces()?.into_iter().map(Target::Wire);
    ask(&wires.chain(addresses.iter().copied().map(Target::Address)).collect::<Vec<_>>())
}

/// The cameras that answer at some places.
///
/// # Errors
/// If the system gives no sockets.
pub fn ask(targets: &[Target]) -> Result<Vec<Found>, GenicamError> {
    let failed = |source| GenicamError::Network { doing: "look for cameras".into(), source };
    let sockets: Vec<(&Target, UdpSocket)> = targets
        .iter()
        .filter_map(|target| match socket(target) {
            Ok(socket) => Some(Ok((target, socket))),
            // An interface that has just gone down keeps nobody from searching the others.
            Err(error) if matches!(target, Target::Wire(_)) => {
                tracing::debug!("{target:?}: {error}");
                None
            }
            Err(error) => Some(Err(failed(error))),
        })
        .collect::<Result<_, _>>()?;
    let mut found: Vec<Found> = Vec::new();
    if sockets.is_empty() {
        return Ok(found);
    }
    let began = Instant::now();
    let mut asked = 0;
    while began.elapsed() < PATIENCE {
        if asked == 0 || (asked == 1 && began.elapsed() >= ASK_AGAIN) {
            asked += 1;
            sockets.iter().for_each(|(target, socket)| send(target, socket));
        }
        for (target, socket) in &sockets {
            take(target, socket, &mut found);
        }
        std::thread::sleep(LOOK_EVERY);
    }
    found.sort_by_key(|found| (found.identity.address, found.identity.mac));
    Ok(found)
}

fn socket(target: &Target) -> io::Result<UdpSocket> {
    let socket = match target {
        Target::Wire(interface) => {
            let socket = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0))?;
            match setsockopt(&socket, BindToDevice, &interface.name.as_str().into()) {
                Ok(()) => socket,
                // Old kernels want a privilege for it. Without, answers by broadcast do not come.
                Err(_) => UdpSocket::bind((interface.address, 0))?,
            }
        }
        Target::Address(_) => UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0))?,
    };
    socket.set_broadcast(true)?;
    socket.set_nonblocking(true)?;
    Ok(socket)
}

fn send(target: &Target, socket: &UdpSocket) {
    let destinations = match target {
        Target::Wire(interface) => vec![Ipv4Addr::BROADCAST, interface.broadcast()],
        Target::Address(address) => vec![*address],
    };
    for destination in destinations {
        if let Err(error) = socket.send_to(&Command::Discover.datagram(ID), SocketAddrV4::new(destination, gvcp::PORT))
        {
            tracing::debug!("{target:?}: {error}");
        }
    }
}

/// Takes the answers that are there.
fn take(target: &Target, socket: &UdpSocket, found: &mut Vec<Found>) {
    let mut buffer = [0; 2048];
    // Somebody who floods the search does not keep it going.
    for _ in 0..256 {
        let Ok(count) = socket.recv(&mut buffer) else { return };
        let Some(identity) = Identity::of_answer(&buffer[..count], ID) else { continue };
        let reach = match target {
            Target::Wire(interface) if interface.reaches(identity.address) => Reach::From(interface.address),
            Target::Wire(interface) => Reach::WrongSubnet(interface.clone()),
            Target::Address(_) => Reach::From(Ipv4Addr::UNSPECIFIED),
        };
        let place = |found: &Found| found.identity.mac == identity.mac && found.identity.address == identity.address;
        match found.iter_mut().find(|found| place(found)) {
            // On two wires, it is the one that reaches it that counts.
            Some(known) if matches!(known.reach, Reach::WrongSubnet(_)) => known.reach = reach,
            Some(_) => {}
            None => found.push(Found { identity, reach }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(address: [u8; 4], mask: [u8; 4], reach: Reach) -> Found {
        let identity = Identity {
            mac: [0; 6],
            address: address.into(),
            mask: mask.into(),
            maker: "Maker".into(),
            model: "M1".into(),
            serial: "1".into(),
            name: String::new(),
        };
        Found { identity, reach }
    }

    #[test]
    fn a_camera_of_another_subnet_is_told_with_what_to_do() {
        let interface =
            Interface { name: "eth1".into(), address: [192, 168, 5, 1].into(), mask: [255, 255, 255, 0].into() };
        assert!(interface.reaches([192, 168, 5, 77].into()) && !interface.reaches([192, 168, 6, 77].into()));
        assert_eq!(interface.broadcast(), Ipv4Addr::new(192, 168, 5, 255));
        let lost = found([169, 254, 1, 250], [255, 255, 0, 0], Reach::WrongSubnet(interface));
        let advice = lost.wrong_subnet().unwrap();
        assert!(advice.contains("169.254.1.250/16") && advice.contains("eth1 (192.168.5.1/24)"), "{advice}");
        assert!(advice.ends_with("`sudo ip addr add 169.254.1.249/16 dev eth1`"), "{advice}");
        assert_eq!(found([10, 0, 0, 1], [255, 0, 0, 0], Reach::From([10, 0, 0, 2].into())).wrong_subnet(), None);
    }

    #[test]
    fn the_loopback_interface_is_searched_by_address_alone() {
        assert!(interfaces().unwrap().iter().all(|interface| !interface.address.is_loopback()));
    }
}
