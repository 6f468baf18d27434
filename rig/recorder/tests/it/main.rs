//! The recorder with puppets for devices, and the live page.

mod live;
mod record;
