//! The events of a camera, from its frames.

use erfgs_dataset::{Camera, CameraEvents, Dataset, layout};
use erfgs_events::{Events, npz};
use erfgs_scene::ImageRgb8;
use serde_json::json;

use super::VariantError;
use crate::simulator::{Luma, Mode, Simulator, SimulatorConfig, camera_key};

/// Luma of every pixel as OpenCV's `COLOR_BGR2GRAY` gives it, which v2e's frames go through: 0.299 R + 0.587 G + 0.114 B of
/// the encoded values in 15-bit fixed point, rounded to a whole level.
#[must_use]
pub fn luma_u8(image: &ImageRgb8) -> Vec<u8> {
    let level = |pixel: &[u8]| {
        let [red, green, blue] = [pixel[0], pixel[1], pixel[2]].map(u32::from);
        ((red * 9798 + green * 19235 + blue * 3735 + (1 << 14)) >> 15) as u8
    };
    image.data.chunks_exact(3).map(level).collect()
}

/// Simulates the events of `camera` of `source` from all its frames at their times. Parity sees luma in whole levels, as
/// v2e does; `enhanced` sees it unrounded.
pub(super) fn simulate(
    source: &Dataset,
    camera: &Camera,
    config: &SimulatorConfig,
) -> Result<(Events, CameraEvents), VariantError> {
    let refused = |source| VariantError::Simulator { camera: camera.name.clone(), source };
    let (width, height) = (camera.intrinsics.width, camera.intrinsics.height);
    let mut simulator = Simulator::new(width, height, config, camera_key(&camera.name)).map_err(refused)?;
    let mut events = Events::new(width, height);
    for frame in &camera.frames {
        let image = source.read_image(camera, frame)?;
        match config.mode {
            Mode::Parity => simulator.step(Luma::U8(&luma_u8(&image)), frame.t_ns, &mut events),
            // Where light is linearised before the logarithm, it is the light of the channels that adds up.
            Mode::Enhanced if config.linear_light => {
                simulator.step(Luma::F32(&image.luminance()), frame.t_ns, &mut events)
            }
            Mode::Enhanced => simulator.step(Luma::F32(&image.luma()), frame.t_ns, &mut events),
        }
        .map_err(refused)?;
    }
    let time = |frame: Option<&erfgs_dataset::Frame>| frame.map_or(0, |frame| frame.t_ns);
    let file = CameraEvents {
        file: layout::events(&camera.name),
        count: events.len() as u64,
        threshold_on: config.threshold_on,
        threshold_off: config.threshold_off,
        lin_log_threshold: SimulatorConfig::LIN_LOG_THRESHOLD,
        linear_light: config.linear_light,
        covers_ns: [time(camera.frames.first()), time(camera.frames.last())],
        simulator: Some(json!({ "name": "erfgs", "config": config, "frames": camera.frames.len() })),
    };
    Ok((events, file))
}

/// Writes the events of a camera.
pub(super) fn write(path: &std::path::Path, camera: &Camera, events: &Events) -> Result<(), VariantError> {
    npz::write_events(path, events).map_err(|source| {
        let (camera, source) = (camera.name.clone(), Box::new(source));
        erfgs_dataset::DatasetError::Events { camera, source }.into()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_luma_is_the_rounded_luma() {
        let mut image = ImageRgb8::new(64, 64);
        image.data.iter_mut().enumerate().for_each(|(at, level)| *level = (at * 7919 % 256) as u8);
        for (whole, exact) in luma_u8(&image).into_iter().zip(image.luma()) {
            assert!((f32::from(whole) - exact).abs() < 0.51, "{whole} {exact}");
        }
        image.data.fill(255);
        assert!(luma_u8(&image).iter().all(|&level| level == 255));
    }
}
