//! The camera that a configuration means, among those that were found.

use crate::frame::FrameError;

/// What cameras can be called by.
pub trait Named {
    /// What the kind of camera is called.
    const KIND: &'static str;
    /// What is said where there is none at all.
    const NONE: &'static str;

    /// Its names, the surest first.
    fn names(&self) -> [String; 5];
    /// What it is, for people.
    fn description(&self) -> String;
}

/// The one that is meant; empty: the only one.
///
/// # Errors
/// If there is none, or there are several.
pub fn choose<T: Named>(id: &str, wanted: &str, mut found: Vec<T>) -> Result<T, FrameError> {
    let list: Vec<String> = found.iter().map(T::description).collect();
    let list = if list.is_empty() { "none".to_owned() } else { list.join("; ") };
    let fail = |problem: String| FrameError::Find { id: id.to_owned(), problem, found: list.clone() };
    for kind in 0..5 {
        let is_meant = |camera: &T| wanted.is_empty() || camera.names()[kind] == wanted;
        let matching: Vec<usize> =
            found.iter().enumerate().filter(|(_, camera)| is_meant(camera)).map(|(at, _)| at).collect();
        match matching[..] {
            [only] => return Ok(found.swap_remove(only)),
            [] => {}
            _ if wanted.is_empty() => {
                return Err(fail(format!("several {}s are there; name one as `camera`", T::KIND)));
            }
            _ => return Err(fail(format!("several are {wanted:?}; name one by its serial number"))),
        }
    }
    Err(fail(if wanted.is_empty() { T::NONE.into() } else { format!("no {} is {wanted:?}", T::KIND) }))
}
