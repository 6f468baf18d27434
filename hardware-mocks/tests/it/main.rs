//! The emulated USB devices, driven transfer by transfer as a host would, in virtual time.

mod davis346;
mod evk4;
mod host;
mod plug;
mod rigfile;
mod uvc;
