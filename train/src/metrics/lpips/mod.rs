//! LPIPS v0.1 (Zhang et al., "The Unreasonable Effectiveness of Deep Features as a Perceptual Metric", CVPR 2018).
//!
//! Features of both pictures after five rectifiers of a network are normalised to unit length at each pixel; the
//! squared differences, weighted by channel, are averaged over pixels and summed over the five layers. The network's
//! code is here, its weights are the user's (`docs/reference/run.md` says how to make the file).

mod layers;
mod weights;

use erfgs_run::{LpipsNet, LpipsScaling};

use self::layers::{Convolution, Map, Window, max_pool};
pub use self::weights::{LpipsError, LpipsWeights};
use super::{MetricError, Picture};

/// The scaling layer of LPIPS: (x - shift) / scale, by channel.
const SHIFT: [f32; 3] = [-0.030, -0.088, -0.188];
const SCALE: [f32; 3] = [0.458, 0.448, 0.450];
/// Keeps the normalisation of an all-zero feature finite.
const EPSILON: f32 = 1e-10;

enum Layer {
    /// Index of the convolution in torchvision's `features`, output channels, window, whether LPIPS looks at it.
    Convolution(usize, usize, Window, bool),
    MaxPool(Window),
}

const fn window(size: usize, stride: usize, padding: usize) -> Window {
    Window { size, stride, padding }
}

fn layers(net: LpipsNet) -> Vec<Layer> {
    use Layer::{Convolution as Conv, MaxPool};
    match net {
        LpipsNet::Alex => vec![
            Conv(0, 64, window(11, 4, 2), true),
            MaxPool(window(3, 2, 0)),
            Conv(3, 192, window(5, 1, 2), true),
            MaxPool(window(3, 2, 0)),
            Conv(6, 384, window(3, 1, 1), true),
            Conv(8, 256, window(3, 1, 1), true),
            Conv(10, 256, window(3, 1, 1), true),
        ],
        LpipsNet::Vgg16 => {
            let blocks: [(usize, &[usize]); 5] =
                [(64, &[0, 2]), (128, &[5, 7]), (256, &[10, 12, 14]), (512, &[17, 19, 21]), (512, &[24, 26, 28])];
            let mut layers = Vec::new();
            for (channels, indices) in blocks {
                if !layers.is_empty() {
                    layers.push(MaxPool(window(2, 2, 0)));
                }
                for (at, &index) in indices.iter().enumerate() {
                    layers.push(Conv(index, channels, window(3, 1, 1), at + 1 == indices.len()));
                }
            }
            layers
        }
    }
}

/// The least width and height of a picture.
fn least_size(net: LpipsNet) -> u32 {
    match net {
        LpipsNet::Alex => 31,
        LpipsNet::Vgg16 => 16,
    }
}

enum Stage {
    /// A convolution and, where LPIPS looks at its output, the weights of the channels.
    Convolution(Convolution, Option<Vec<f32>>),
    MaxPool(Window),
}

/// A network with its weights, ready to compare pictures.
pub struct Lpips {
    net: LpipsNet,
    stages: Vec<Stage>,
}

impl std::fmt::Debug for Lpips {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Lpips").field("net", &self.net).finish_non_exhaustive()
    }
}

impl Lpips {
    /// Builds the network that the weights are for.
    ///
    /// # Errors
    /// [`LpipsError`] where a tensor is missing or has the wrong shape.
    pub fn new(weights: &LpipsWeights) -> Result<Self, LpipsError> {
        let net =
            if weights.shape("features.0.weight")?.last() == Some(&11) { LpipsNet::Alex } else { LpipsNet::Vgg16 };
        let (mut inputs, mut looks) = (3, 0);
        let mut stages = Vec::new();
        for layer in layers(net) {
            stages.push(match layer {
                Layer::MaxPool(window) => Stage::MaxPool(window),
                Layer::Convolution(index, outputs, window, looked_at) => {
                    let shape = [outputs, inputs, window.size, window.size];
                    let kernel = weights.tensor(&format!("features.{index}.weight"), &shape)?;
                    let bias = weights.tensor(&format!("features.{index}.bias"), &[outputs])?;
                    let convolution = Convolution::new(window, inputs, outputs, &kernel, bias);
                    inputs = outputs;
                    let linear = if looked_at {
                        let name = format!("lin{looks}.model.1.weight");
                        looks += 1;
                        Some(weights.tensor(&name, &[1, outputs, 1, 1])?)
                    } else {
                        None
                    };
                    Stage::Convolution(convolution, linear)
                }
            });
        }
        Ok(Self { net, stages })
    }

    /// The network.
    #[must_use]
    pub fn net(&self) -> LpipsNet {
        self.net
    }

    /// The distance between two pictures. 0 means that the network sees no difference.
    ///
    /// # Errors
    /// [`MetricError::Sizes`] and [`MetricError::TooSmall`].
    pub fn distance(&self, a: Picture<'_>, b: Picture<'_>, scaling: LpipsScaling) -> Result<f64, MetricError> {
        a.same_size(b)?;
        let least = least_size(self.net);
        if a.width < least || a.height < least {
            return Err(MetricError::TooSmall { width: a.width, height: a.height, least });
        }
        let (mut a, mut b) = (input(a, scaling), input(b, scaling));
        let mut distance = 0.0;
        for stage in &self.stages {
            match stage {
                Stage::MaxPool(window) => (a, b) = rayon::join(|| max_pool(&a, *window), || max_pool(&b, *window)),
                Stage::Convolution(convolution, linear) => {
                    (a, b) = rayon::join(|| convolution.apply(&a), || convolution.apply(&b));
                    if let Some(linear) = linear {
                        distance += compare(&a, &b, linear);
                    }
                }
            }
        }
        Ok(distance)
    }
}

fn input(picture: Picture<'_>, scaling: LpipsScaling) -> Map {
    let (gain, offset) = match scaling {
        LpipsScaling::ZeroToOne => (1.0, 0.0),
        LpipsScaling::MinusOneToOne => (2.0, -1.0),
    };
    let pixel = |rgb: &[f32; 3]| std::array::from_fn::<f32, 3, _>(|c| (gain * rgb[c] + offset - SHIFT[c]) / SCALE[c]);
    let values = picture.rgb.as_chunks::<3>().0.iter().flat_map(pixel).collect();
    Map { height: picture.height as usize, width: picture.width as usize, channels: 3, values }
}

/// Mean over pixels of the weighted squared difference of unit-length features.
fn compare(a: &Map, b: &Map, linear: &[f32]) -> f64 {
    let inverse_length = |features: &[f32]| 1.0 / (features.iter().map(|f| f * f).sum::<f32>().sqrt() + EPSILON);
    let mut sum = 0.0;
    for (a, b) in a.values.chunks_exact(a.channels).zip(b.values.chunks_exact(b.channels)) {
        let (la, lb) = (inverse_length(a), inverse_length(b));
        let weighted = a.iter().zip(b).zip(linear).map(|((a, b), w)| w * (a * la - b * lb) * (a * la - b * lb));
        sum += f64::from(weighted.sum::<f32>());
    }
    sum / (a.width * a.height) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_least_size_is_the_least_that_leaves_a_pixel() {
        for net in [LpipsNet::Alex, LpipsNet::Vgg16] {
            let left = |size: u32| {
                layers(net).iter().fold(size as usize, |size, layer| match layer {
                    Layer::Convolution(_, _, window, _) | Layer::MaxPool(window) => window.positions(size),
                })
            };
            assert_eq!((left(least_size(net) - 1), left(least_size(net))), (0, 1), "{net:?}");
        }
    }
}
