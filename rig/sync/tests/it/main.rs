//! Sessions whose clocks break, run freely, or are told by a flash.

mod breaks;
mod flash;
