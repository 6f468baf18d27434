//! Methods, motion models and presets, as the command line spells them.

use erfgs_train::config::{Method, MotionModel, Preset};

/// A method, as the command line spells it.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
pub enum MethodName {
    /// The baseline.
    #[value(name = "4dgs")]
    FourDgs,
    /// Event-RGB fusion.
    ErfGs,
}

impl MethodName {
    /// Its spelling.
    pub fn name(self) -> &'static str {
        match self {
            Self::FourDgs => "4dgs",
            Self::ErfGs => "erf-gs",
        }
    }
}

/// A motion model, as the command line spells it.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
pub enum MotionName {
    /// A deformation field of planes and a network.
    #[value(name = "hexplane")]
    HexPlane,
    /// A trajectory and a life for each Gaussian.
    FreeTime,
    /// Bodies whose Gaussians share paths, found by `erfgs dataset bodies`
    Bodies,
    /// Nothing moves.
    Still,
    /// Chosen by what the dataset contains.
    Auto,
}

impl From<MotionName> for MotionModel {
    fn from(name: MotionName) -> Self {
        match name {
            MotionName::HexPlane => Self::HexPlane,
            MotionName::FreeTime => Self::FreeTime,
            MotionName::Bodies => Self::Bodies,
            MotionName::Still => Self::Still,
            MotionName::Auto => Self::Auto,
        }
    }
}

impl From<MethodName> for Method {
    fn from(name: MethodName) -> Self {
        match name {
            MethodName::FourDgs => Self::FourDgs,
            MethodName::ErfGs => Self::ErfGs,
        }
    }
}

/// A preset, as the command line spells it.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
pub enum PresetName {
    /// The paper.
    Paper,
    /// Its released code.
    ReleasedCode,
    /// Ours.
    Default,
}

impl PresetName {
    /// Its spelling.
    pub fn name(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::ReleasedCode => "released-code",
            Self::Default => "default",
        }
    }
}

impl From<PresetName> for Preset {
    fn from(name: PresetName) -> Self {
        match name {
            PresetName::Paper => Self::Paper,
            PresetName::ReleasedCode => Self::ReleasedCode,
            PresetName::Default => Self::Default,
        }
    }
}
