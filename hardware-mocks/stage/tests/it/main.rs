//! The stage: its events against its own intensity, and what it films.

mod events;
mod film;
