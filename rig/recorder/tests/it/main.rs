//! The recorder with puppets for devices, and the live page.

mod hosts;
mod live;
mod record;
