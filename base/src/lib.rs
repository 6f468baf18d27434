//! What every room of erfgs stands on, and what none of them is about.
//!
//! - [`atomic`]: files and folders that appear whole or not at all (feature `files`).
//! - [`scratch`]: private folders for intermediate files (feature `files`).
//! - [`children`]: other programs, run to their end or until they hang (feature `children`).
//! - [`ending`]: what must not outlive the process.
//! - [`random`]: counter-based random numbers, which do not depend on threads or the order of work.
//! - [`progress`]: long jobs on all cores, and how far they have come (feature `parallel`).
//! - [`cpu`]: CPU time of a thread or of the process (feature `cpu`).
//! - [`memory`]: how much memory is free, and whether that is enough.
//! - [`names`]: names from files, as names of files and on a terminal.
//! - [`mod@order`]: the order of names as a person sees it.
//! - [`npy`]: NumPy's arrays.
//! - [`plausible`]: what numbers of files and settings are believed.
//! - [`regular`]: files, and nothing that only looks like one.
//! - [`text`]: text files, whatever editor wrote them.
//! - [`FileError`]: a file that could not be read or written, with what helps; [`copy_file`].
//! - [`calendar`](mod@calendar): dates as UTC.

#[cfg(feature = "files")]
pub mod atomic;
pub mod calendar;
#[cfg(feature = "children")]
pub mod children;
#[cfg(feature = "cpu")]
pub mod cpu;
pub mod ending;
mod file_error;
pub mod memory;
pub mod names;
pub mod npy;
pub mod order;
pub mod plausible;
#[cfg(feature = "parallel")]
pub mod progress;
pub mod random;
pub mod regular;
#[cfg(feature = "files")]
pub mod scratch;
pub mod text;

pub use file_error::{FileError, copy_file};
#[cfg(feature = "parallel")]
pub use progress::Progress;

/// The example of the README.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
