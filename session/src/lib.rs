//! The session file of a rig: what every device delivered, byte for byte, in one MCAP file, and what it takes to read it.
//!
//! Times are `i64` nanoseconds on the session clock, which is the host's monotonic clock with its zero where the recording
//! started.
//!
//! Written, and read again:
//!
//! ```
//! use erfgs_events::{Columns, EventEncoding};
//! use erfgs_session::{
//!     Session, SessionWriter,
//!     container::{SessionStart, Settings},
//!     source::{Description, Packet},
//! };
//!
//! # let folder = tempfile::tempdir()?;
//! # let path = folder.path().join("take1.mcap");
//! // Times of the host are nanoseconds of its monotonic clock; here it stood at 5 s when the recording began.
//! let start = SessionStart { host_ns: 5_000_000_000, program: "example 1.0".into(), ..SessionStart::default() };
//! let mut writer = SessionWriter::create(&path, start, "", Settings::default())?;
//! let camera = writer.add_stream(&Description {
//!     id: "ev0".into(),
//!     model: "Prophesee EVK4".into(),
//!     serial: "00050567".into(),
//!     encoding: EventEncoding::Evt3.into(),
//!     width: 1280,
//!     height: 720,
//!     start_order: 0,
//!     settings: Default::default(),
//! })?;
//! let words = [0x8000_u16, 0x6064, 0x0007, 0x2805, 0x2009].map(u16::to_le_bytes).concat();
//! let packet = Packet {
//!     sequence: 0,
//!     host_ns: 5_000_200_000,
//!     discontinuity: false,
//!     damaged: false,
//!     stamp: None,
//!     payload: words.into(),
//! };
//! writer.packet(camera, &packet)?;
//! writer.finish()?;
//!
//! let mut session = Session::open(&path)?;
//! let (stream, _) = session.stream("ev0")?;
//! let mut events = Columns::default();
//! session.decode_events(stream, None, &mut events, |_bytes| {})?;
//! assert_eq!((events.t_us, events.x, events.y), (vec![100, 100], vec![5, 9], vec![7, 7]));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Whatever a recording is, packet by packet:
//!
//! ```
//! use erfgs_session::{Recording, container::Entry};
//!
//! # let folder = tempfile::tempdir()?;
//! # let path = folder.path().join("events.csv");
//! # std::fs::write(&path, "t,x,y,on\n1000,3,4,1\n1020,3,5,0\n")?;
//! let mut recording = Recording::open(&path, None)?; // a session, or an event file of another program
//! let ids: Vec<String> = recording.summary().streams.iter().map(|stream| stream.description.id.clone()).collect();
//! for entry in recording.messages(None) {
//!     if let Entry::Packet { stream, packet } = entry? {
//!         println!("{}: packet {} of {} bytes", ids[stream], packet.sequence, packet.payload.len());
//!     }
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! - [`container`]: the file; a recording that was cut short is [recovered](container::recover).
//! - [`source`]: what a device delivers while it records, and the trait behind which drivers stand.
//! - [`clock`]: the lines that take ticks of devices to session time.
//! - [`trigger`]: the words of the trigger board.
//!
//! # Features
//!
//! The default is `file` and `pictures`; without any there are sources, packets and clocks, which is what a driver needs.
//!
//! - `file`: the session file, and event files read as sessions are.
//! - `pictures`: frames decoded ([`Description::frame_format`](source::Description::frame_format)).
//! - `export`: the files that streams become: event files, pictures, videos; with `exr` OpenEXR, too.
//! - `rosbag2`: recordings of rosbag2 in SQLite (`.db3`), with SQLite.
//! - `hdf5`: events in HDF5 files, with libhdf5, which must be installed.

pub mod clock;
#[cfg(feature = "file")]
pub mod container;
mod encoding;
mod event_picture;
#[cfg(feature = "export")]
pub mod export;
pub mod sensor;
pub mod source;
pub mod trigger;

pub use event_picture::EventPicture;

#[cfg(feature = "file")]
pub use container::{Recording, Session, SessionWriter};

/// The example of the README.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
