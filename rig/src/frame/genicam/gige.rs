//! GigE Vision cameras among those that are listed, and the one that a configuration means.

use std::net::Ipv4Addr;

use crate::{
    frame::{FoundCamera, FrameConfig, FrameError},
    genicam::gige::{self, Found},
};

/// The GigE Vision cameras of this machine's networks, and at some addresses beside.
///
/// # Errors
/// If the networks cannot be searched.
pub fn list(addresses: &[Ipv4Addr]) -> Result<Vec<FoundCamera>, FrameError> {
    let found = gige::find(addresses).map_err(|error| FrameError::List { reason: error.to_string() })?;
    Ok(found.iter().map(told).collect())
}

fn told(found: &Found) -> FoundCamera {
    let identity = &found.identity;
    let named = if identity.name.is_empty() { String::new() } else { format!(" \"{}\"", identity.name) };
    FoundCamera {
        name: format!("{}{named}", identity.label()),
        serial: identity.serial.clone(),
        bus: identity.address.to_string(),
        node: identity.mac_text().into(),
        driver: "gige".into(),
        formats: Vec::new(),
        problem: found.wrong_subnet().or_else(|| found.in_use()),
    }
}

/// The camera that a configuration means.
pub fn choose(config: &FrameConfig) -> Result<Found, FrameError> {
    let wanted = config.camera.as_str();
    let mut addresses = config.genicam.clone().unwrap_or_default().addresses;
    // An address may lie where broadcasts do not come.
    addresses.extend(wanted.parse::<Ipv4Addr>());
    let found = gige::find(&addresses).map_err(|source| FrameError::Genicam {
        id: config.id.clone(),
        camera: wanted.to_owned(),
        source: source.into(),
    })?;
    choose_among(&config.id, wanted, found)
}

fn choose_among(id: &str, wanted: &str, found: Vec<Found>) -> Result<Found, FrameError> {
    let list: Vec<String> = found
        .iter()
        .map(|found| {
            let identity = &found.identity;
            format!("{} (serial {}, at {})", identity.label(), identity.serial, identity.address)
        })
        .collect();
    let list = if list.is_empty() { "none".to_owned() } else { list.join("; ") };
    let fail = |problem: String| FrameError::Find { id: id.to_owned(), problem, found: list.clone() };
    let kinds: [fn(&Found) -> String; 5] = [
        |found| found.identity.serial.clone(),
        |found| found.identity.address.to_string(),
        |found| found.identity.mac_text(),
        |found| found.identity.name.clone(),
        |found| found.identity.label(),
    ];
    for kind in kinds {
        let mut matching = found.iter().filter(|found| wanted.is_empty() || kind(found) == wanted);
        match (matching.next(), matching.next()) {
            (Some(camera), None) => return Ok(camera.clone()),
            (Some(_), Some(_)) if wanted.is_empty() => {
                return Err(fail("several GigE Vision cameras are there; name one as `camera`".into()));
            }
            (Some(_), Some(_)) => return Err(fail(format!("several are {wanted:?}; name one by its serial number"))),
            (None, _) => {}
        }
    }
    Err(fail(if wanted.is_empty() {
        "no GigE Vision camera answers; behind a router name it by its address".into()
    } else {
        format!("no GigE Vision camera is {wanted:?}")
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::genicam::gige::{Reach, gvcp::Identity};

    fn camera(number: u8, serial: &str, name: &str) -> Found {
        let identity = Identity {
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
            assert_eq!(choose_among("x", wanted, both()).unwrap().identity.serial, serial);
        }
        let said = |wanted| choose_among("x", wanted, both()).unwrap_err().to_string();
        assert!(
            said("Maker M1").contains("several are \"Maker M1\"") && said("C3").contains("serial B2, at 192.168.1.2")
        );
        assert!(said("").contains("name one as `camera`"));
        assert!(choose_among("x", "", Vec::new()).unwrap_err().to_string().contains("behind a router"));
        assert_eq!(choose_among("x", "", vec![camera(3, "", "")]).unwrap().identity.mac[5], 3);
    }
}
