//! What a variant is to be.

use serde::{Deserialize, Serialize};

use crate::simulator::SimulatorConfig;

/// Which training cameras keep their events alone.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EventOnly {
    /// None.
    #[default]
    None,
    /// So many, drawn uniformly with the seed among the training cameras that have frames.
    Count(u32),
    /// Those called so.
    Names(Vec<String>),
}

/// Which frames a blurred frame averages.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Window {
    /// The frame and those after it, as the paper's code does.
    #[default]
    Forward,
    /// As many before as after (one more after, where the number is even).
    Centred,
}

/// What happens to a kept frame whose window runs past the clip.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Edge {
    /// It is left out: that exposure was never recorded. With 45 frames, every fourth kept and three averaged, the frame
    /// 44 goes, and 40 (the mean of 40, 41, 42) is the last; so does the paper's code.
    #[default]
    Drop,
    /// It averages the frames that there are, and its exposure is shorter accordingly; the last one may be sharp.
    Shorten,
}

/// How the mean is brought back to 8 bits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Rounding {
    /// Towards zero, as the paper's code does; half a grey level too dark on average.
    #[default]
    Truncate,
    /// To the nearest.
    Nearest,
}

/// The time that a blurred frame is labelled with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Label {
    /// The time of the kept frame, as the paper's code does.
    #[default]
    Frame,
    /// The middle of the exposure.
    Mid,
}

/// Motion blur by averaging frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BlurOptions {
    /// How many successive frames make one; 1 leaves the frames sharp.
    pub frames: u32,
    /// Which frames are averaged.
    pub window: Window,
    /// What happens at the clip's ends.
    pub edge: Edge,
    /// How the mean is brought back to 8 bits.
    pub rounding: Rounding,
    /// Whether the mean is taken in linear light, as a real exposure does, and not on the encoded values.
    pub linear_light: bool,
    /// The time that a blurred frame is labelled with.
    pub label: Label,
}

impl Default for BlurOptions {
    fn default() -> Self {
        Self {
            frames: 1,
            window: Window::default(),
            edge: Edge::default(),
            rounding: Rounding::default(),
            linear_light: false,
            label: Label::default(),
        }
    }
}

/// What a variant is to be. Every field has a default, which changes nothing.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct VariantOptions {
    /// Name of the variant; by default the source's name with a suffix for what was done, for example `basketball-dv`.
    pub name: Option<String>,
    /// Keep each so many-th frame of the training cameras, beginning with the first; 1 keeps all.
    pub subsample: u32,
    /// Motion blur of the training cameras' frames.
    pub blur: BlurOptions,
    /// Which training cameras keep their events alone.
    pub event_only: EventOnly,
    /// Whether training cameras that keep their frames get simulated events too.
    pub keep_rgb_events: bool,
    /// Whether the source's initial point cloud is kept. It may have been made from frames that the variant no longer
    /// has, and is left out by default wherever the frames change.
    pub keep_points: bool,
    /// The event simulator. Its seed is replaced by `seed`.
    pub simulator: SimulatorConfig,
    /// The seed of everything random.
    pub seed: u64,
}

impl Default for VariantOptions {
    fn default() -> Self {
        Self {
            name: None,
            subsample: 1,
            blur: BlurOptions::default(),
            event_only: EventOnly::None,
            keep_rgb_events: false,
            keep_points: false,
            simulator: SimulatorConfig::default(),
            seed: 0,
        }
    }
}
