//! Machine-vision cameras as sources of frames. [`camera`] is the same for all; what differs is a [`link::Link`].

mod camera;
mod choose;
mod frames;
mod gige;
mod link;
mod u3v;
mod watch;

pub use camera::GenicamCamera;
pub use gige::{GigeLink, list as list_gige};
pub use u3v::{U3vLink, list as list_u3v, list_on as list_u3v_on};
