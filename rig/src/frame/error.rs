use std::io;

/// What can go wrong with an RGB camera.
#[derive(Debug, thiserror::Error)]
pub enum FrameError {
    /// A field of the configuration cannot be.
    #[error("the configuration of camera {id:?}: {problem}")]
    Config {
        /// The camera's name in the rig.
        id: String,
        /// What is wrong, and what would be right.
        problem: String,
    },
    /// The system does not list its cameras.
    #[error("cannot list cameras: {reason}")]
    List {
        /// Why.
        reason: String,
    },
    /// No camera, or more than one, is what the configuration means.
    #[error("camera {id:?}: {problem}; plugged in are: {found}. `erfgs devices` tells more")]
    Find {
        /// The camera's name in the rig.
        id: String,
        /// "none is ..." or "several are ...".
        problem: String,
        /// What there is.
        found: String,
    },
    /// The camera does not do something that it must.
    #[error("camera {id:?} ({node}) fails to {doing}: {source}{advice}")]
    Camera {
        /// The camera's name in the rig.
        id: String,
        /// Its node.
        node: String,
        /// What was being done.
        doing: String,
        /// Why not.
        source: io::Error,
        /// What to do, with the punctuation before it; may be empty.
        advice: &'static str,
    },
    /// The camera chose another format than the one asked for.
    #[error("camera {id:?} ({node}) has no {asked}: it offers {offered} instead. Its formats: {formats}")]
    Format {
        /// The camera's name in the rig.
        id: String,
        /// Its node.
        node: String,
        /// What was asked for.
        asked: String,
        /// What it would give.
        offered: String,
        /// All its formats.
        formats: String,
    },
    /// A control cannot be set to what is asked for.
    #[error("camera {id:?} cannot set {control} to {value}: {reason}")]
    Control {
        /// The camera's name in the rig.
        id: String,
        /// Which.
        control: &'static str,
        /// To what.
        value: String,
        /// Why not, and what would do.
        reason: String,
    },
    /// A machine-vision camera.
    #[cfg(target_os = "linux")]
    #[error("camera {id:?} ({camera}): {source}")]
    Genicam {
        /// The camera's name in the rig.
        id: String,
        /// Maker, model and address.
        camera: String,
        /// What is wrong, and what to do.
        source: Box<crate::genicam::GenicamError>,
    },
    /// The portable library says no.
    #[error("camera {id:?} through {system}: cannot {doing}: {reason}")]
    Portable {
        /// The camera's name in the rig.
        id: String,
        /// The system's interface.
        system: &'static str,
        /// What was being done.
        doing: &'static str,
        /// Why not.
        reason: String,
    },
}
