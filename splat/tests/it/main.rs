//! Runs that are opened from their folders alone.

#[path = "../../examples/draw.rs"]
#[expect(dead_code, reason = "its main is for who runs it by itself")]
mod draw;
mod trained;
