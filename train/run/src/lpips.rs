//! Which LPIPS a value is.

use serde::{Deserialize, Serialize};

/// The backbone whose features are compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LpipsNet {
    /// AlexNet.
    Alex,
    /// VGG16.
    Vgg16,
}

/// How pictures in [0, 1] enter the network.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LpipsScaling {
    /// As they are: what the 4DGS evaluation does, although the network's constants assume [-1, 1].
    ZeroToOne,
    /// Scaled to [-1, 1], as LPIPS intends.
    MinusOneToOne,
}

/// Which LPIPS a value is. Values of different kinds are not comparable.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct LpipsKind {
    /// The backbone.
    pub net: LpipsNet,
    /// The input's scaling.
    pub scaling: LpipsScaling,
}

impl std::fmt::Display for LpipsKind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let net = match self.net {
            LpipsNet::Alex => "AlexNet",
            LpipsNet::Vgg16 => "VGG16",
        };
        let scaling = match self.scaling {
            LpipsScaling::ZeroToOne => "[0, 1]",
            LpipsScaling::MinusOneToOne => "[-1, 1]",
        };
        write!(f, "{net}, {scaling}")
    }
}
