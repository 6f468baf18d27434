//! The host of a UVC camera: what the kernel's driver does between the wire and a program.

use std::sync::Arc;

use erfgs_base::random;
use erfgs_hardware_mocks::usb::{Plug, Reply, Urb, UsbDevice, Uvc, uvc::STREAM};
use erfgs_rig::frame::FrameConfig;
use erfgs_scene::pixel::PixelFormat;
use erfgs_session::source::{Description, Encoding, FrameStamp, Incident, Outlet, Packet, StampClock, StampPoint};
use serde_json::json;

use crate::world::Stepped;

/// Bytes of a payload at most.
const PAYLOAD_BYTES: usize = 1 << 20;
/// The format is the first that these cameras have, as is the size.
const FIRST: u8 = 1;
/// Requests to the camera's terminal and to its stream.
const SET: u8 = 0x01;
const GET: u8 = 0x81;
/// The terminal's unit and the control's number, as an index and a value.
const CAMERA_UNIT: u16 = 0x0100;
const EXPOSURE_MODE: u16 = 0x0200;
const EXPOSURE: u16 = 0x0400;

/// A camera and what has arrived of it.
pub struct UvcHost {
    device: Plug<Uvc>,
    is_gone: bool,
    description: Description,
    outlet: Arc<dyn Outlet>,
    at_ns: i64,
    frame: Vec<u8>,
    stamp_ns: Option<i64>,
    sequence: u32,
    key: u64,
}

/// What the session says of such a camera.
#[must_use]
pub fn description(config: &FrameConfig, exposure_us: f64) -> Description {
    let settings = json!({
        "backend": "v4l2",
        "driver": "uvcvideo (emulated)",
        "rate_hz": config.rate_hz,
        "triggered": config.triggered,
        "exposure_us": exposure_us,
    });
    Description {
        id: config.id.clone(),
        model: "Emulated UVC camera".into(),
        serial: config.camera.clone(),
        encoding: Encoding::Frames(PixelFormat::Mjpeg),
        width: config.width,
        height: config.height,
        start_order: 10,
        settings: settings.as_object().cloned().unwrap_or_default(),
    }
}

impl UvcHost {
    /// Sets exposure, format and rate as a driver would, and starts the stream.
    #[must_use]
    pub fn start(
        mut device: Plug<Uvc>,
        description: Description,
        rate_hz: f64,
        outlet: Arc<dyn Outlet>,
        now_ns: i64,
    ) -> Self {
        let exposure_us = description.exposure_ns().map_or(0, |ns| ns / 1000);
        let units = u32::try_from(exposure_us / 100).unwrap_or(1);
        let mut set = |value: u16, index: u16, data: &[u8]| {
            device.submit(&Urb::control_out(0x21, SET, value, index, data), now_ns);
        };
        set(EXPOSURE_MODE, CAMERA_UNIT, &[1]);
        set(EXPOSURE, CAMERA_UNIT, &units.to_le_bytes());
        let mut wish = vec![1, 0, FIRST, FIRST];
        wish.extend(((1e7 / rate_hz).round() as u32).to_le_bytes());
        wish.resize(26, 0);
        set(0x0100, 1, &wish);
        let answer = device.submit(&Urb::control_in(0xa1, GET, 0x0100, 1, 26), now_ns);
        if let Reply::Data(answer) = answer {
            device.submit(&Urb::control_out(0x21, SET, 0x0200, 1, &answer), now_ns);
        }
        let key = description.serial.bytes().fold(7, |key, byte| random::extend(key, byte.into()));
        let (frame, stamp_ns, sequence) = (Vec::new(), None, 0);
        Self { device, is_gone: false, description, outlet, at_ns: now_ns, frame, stamp_ns, sequence, key }
    }

    /// A payload that came at a time: 12 bytes of header, and a piece of a frame.
    fn payload(&mut self, bytes: &[u8], at_ns: i64) {
        let Some((&[length, flags], _)) = bytes.split_first_chunk::<2>() else { return };
        // As the kernel does: the time at which the first piece was seen, some microseconds after it came.
        let wait = |word: u64, mean_ns: f64| {
            let key = random::key(self.key, &[self.sequence.into(), word]);
            (mean_ns * random::exponential(key)) as i64
        };
        let (seen_ns, arrived_ns) = (at_ns + 20_000 + wait(0, 30_000.0), at_ns + 150_000 + wait(1, 150_000.0));
        let stamp_ns = *self.stamp_ns.get_or_insert(seen_ns);
        self.frame.extend_from_slice(bytes.get(usize::from(length)..).unwrap_or_default());
        if flags & 2 == 0 {
            return;
        }
        let stamp = FrameStamp {
            kernel_ns: stamp_ns,
            clock: StampClock::Monotonic,
            point: StampPoint::StartOfExposure,
            sequence: self.sequence,
        };
        self.outlet.send(Packet {
            sequence: self.sequence.into(),
            host_ns: arrived_ns,
            discontinuity: false,
            damaged: false,
            stamp: Some(stamp),
            payload: std::mem::take(&mut self.frame).into(),
        });
        self.stamp_ns = None;
        self.sequence += 1;
    }
}

impl Stepped for UvcHost {
    fn until(&mut self, now_ns: i64) {
        let mut at_ns = self.at_ns;
        while at_ns <= now_ns {
            match self.device.submit(&Urb::bulk_in(STREAM, PAYLOAD_BYTES), at_ns) {
                Reply::Data(bytes) => self.payload(&bytes, at_ns),
                Reply::Gone => {
                    if !std::mem::replace(&mut self.is_gone, true) {
                        let reason = format!("camera {} was unplugged", self.description.id);
                        self.outlet.report(Incident::Lost { reason });
                    }
                    break;
                }
                _ => at_ns = self.device.wake_ns(at_ns).max(at_ns + 50_000),
            }
        }
        self.at_ns = now_ns;
    }
}

impl std::fmt::Debug for UvcHost {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("UvcHost").field("id", &self.description.id).finish_non_exhaustive()
    }
}
