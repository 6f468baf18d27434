//! The presets: the paper, its released code, and ours.

use super::{
    BlurConfig, BodiesOptions, CameraColourOptions, CameraPoseOptions, CameraTimeOptions, Coherence, Config,
    DensityConfig, DynamicConfig, EarlConfig, EdsConfig, EvaluationConfig, FieldOptions, FreeTimeOptions, Guide,
    InitConfig, LearningRates, Method, MotionModel, Norm, Pairing, Preset, Quantise, ShConfig, Switch, Uniqueness,
};

impl Config {
    /// The configuration of `preset` for `method`.
    #[must_use]
    pub fn preset(method: Method, preset: Preset) -> Self {
        let mut config = match preset {
            Preset::ReleasedCode => Self::released_code(),
            Preset::Paper => Self::paper(),
            Preset::Default => Self::ours(),
        };
        config.method = method;
        config.preset = preset;
        if method == Method::FourDgs {
            config.earl.enabled = false;
            config.eds.enabled = false;
            // The baseline knows neither events nor a model of the exposure, as 4DGS was published.
            config.blur.model = Switch::Off;
        }
        config
    }

    /// ERF-GS as released, with the sizes of its Neu3D configuration.
    fn released_code() -> Self {
        Self {
            method: Method::ErfGs,
            preset: Preset::ReleasedCode,
            seed: 0,
            coarse_iterations: 3000,
            fine_iterations: 14_000,
            batch: 2,
            background: [1.0; 3],
            near_m: 0.2,
            near_share: 0.0,
            near_sigmas: 0.0,
            static_set: None,
            init: InitConfig { max_points: 40_000, random_points: 10_000, opacity: 0.1 },
            sh: ShConfig { max_degree: 3, raise_every: 1000 },
            learning_rate: LearningRates {
                position: [1.6e-4, 1.6e-6],
                network: [1.6e-4, 1.6e-5],
                planes: [1.6e-3, 1.6e-4],
                sh_dc: 2.5e-3,
                sh_rest: 2.5e-3 / 20.0,
                opacity: 0.05,
                scale: 5e-3,
                rotation: 1e-3,
                decay_steps: 25_000,
                adam_epsilon: 1e-8,
            },
            motion: MotionModel::HexPlane,
            free_time: FreeTimeOptions::default(),
            bodies: BodiesOptions::default(),
            field: FieldOptions {
                levels: vec![1, 2],
                features: 16,
                spatial_resolution: 64,
                time_resolution: 150,
                upper_half_time: true,
                width: 128,
                depth: 0,
                zero_heads: false,
                opacity_head: true,
                scale_head: true,
                rotation_head: true,
                sh_head: true,
                weight_spatial: 2e-4,
                weight_time: 1e-3,
                weight_l1_time: 1e-4,
                regularise_every: 1,
                box_of_moving: false,
            },
            density: DensityConfig {
                from: 500,
                every: 200,
                until: 10_000.0 / 14_000.0,
                gradient_threshold: 2e-4,
                split_extent: 0.01,
                max_gaussians: 200_000,
                prune_above: 150_000,
                min_opacity: 0.005,
                max_extent: 0.0,
                max_screen: 0.0,
                opacity_reset_every: 0,
            },
            earl: EarlConfig {
                enabled: true,
                weight: 0.1,
                beside_frames: 1.0,
                weight_trajectory: 0.01,
                weight_colour: 0.01,
                share: 0.0,
                from: 0,
                quantise: Quantise::TruncateSte,
                norm: Norm::L1,
                confidence: true,
                pairing: Pairing::FrameAnchored,
                bins: 0,
                denoise: true,
                balance: false,
                flicker: false,
                still_learn: true,
            },
            eds: EdsConfig {
                enabled: true,
                from: 500,
                every: 200,
                until: 10_000.0 / 14_000.0,
                max_gaussians: 250_000,
                depths: 200,
                stride: 2,
                sources: 3,
                min_events: 1.0,
                count: 1000,
                neighbours: 3,
                uniqueness: Uniqueness::SmallestDepth,
                tolerance_px: 0,
                all_must_see: true,
                both_ends: true,
                own_deformation: true,
                coherence: Coherence::Largest,
                max_distance: 1.0,
                opacity_logit: 1.0,
            },
            camera_colour: CameraColourOptions::default(),
            camera_pose: CameraPoseOptions::default(),
            camera_time: CameraTimeOptions::default(),
            blur: BlurConfig { model: Switch::Off, samples: 3, one_gradient: false, instant: None },
            dynamic: DynamicConfig {
                skip_static: false,
                motion_threshold: 0.06,
                grow_px: 2,
                share: 0.5,
                whole_image_every: 1,
                coarse_without_moving: false,
            },
            evaluation: EvaluationConfig {
                every: 0,
                count: 24,
                frames: 16,
                frame_stride: 1,
                checkpoint_every: 1000,
                checkpoint_minutes: 10.0,
                log_every: 50,
            },
        }
    }

    /// ERF-GS as the paper writes it: where the text differs from the released code.
    fn paper() -> Self {
        let mut config = Self::released_code();
        config.preset = Preset::Paper;
        config.eds.depths = 100;
        config.eds.count = 500;
        config.eds.coherence = Coherence::Smallest;
        config.eds.tolerance_px = 1;
        config.eds.all_must_see = false;
        config
    }

    /// The preset `default`: the paper, but for what is set here.
    fn ours() -> Self {
        let mut config = Self::paper();
        config.preset = Preset::Default;
        config.coarse_iterations = 600;
        config.fine_iterations = 4000;
        config.batch = 1;
        config.near_share = 0.8;
        config.near_sigmas = 3.0;
        config.dynamic.coarse_without_moving = true;
        config.background = [0.0; 3];
        config.sh.max_degree = 1;
        config.motion = MotionModel::Auto;
        config.free_time.guide = Guide::Auto;
        // A parabola cannot follow what events see of it between frames.
        config.free_time.knots = 2;
        // Ten times the published rate, for a quarter to a seventh of the published iterations.
        config.learning_rate.position = [1.6e-3, 1.6e-5];
        config.learning_rate.decay_steps = 0;
        config.learning_rate.adam_epsilon = 1e-15;
        config.field.time_resolution = 0;
        config.field.upper_half_time = false;
        config.field.zero_heads = true;
        config.field.width = 64;
        config.field.sh_head = false;
        config.field.regularise_every = 4;
        config.field.box_of_moving = true;
        config.density.from = 300;
        config.density.every = 100;
        config.density.until = 0.6;
        config.density.gradient_threshold = 5e-4;
        config.density.max_gaussians = 0;
        config.density.prune_above = 0;
        config.density.max_extent = 0.5;
        config.earl.weight = 0.2;
        config.earl.beside_frames = 0.5;
        config.earl.share = 0.5;
        config.earl.quantise = Quantise::DeadZone;
        config.earl.pairing = Pairing::Level;
        config.earl.denoise = false;
        config.earl.balance = true;
        config.earl.flicker = true;
        // What stands still makes no events: what moves and is not explained yet would be put down to it.
        config.earl.still_learn = false;
        config.eds.max_gaussians = 0;
        config.eds.from = 300;
        config.eds.count = 200;
        config.eds.max_distance = 0.05;
        // As all figures of lab/notebook were taken.
        config.eds.uniqueness = Uniqueness::OnlyRun;
        config.eds.tolerance_px = 0;
        config.eds.all_must_see = true;
        config.eds.both_ends = false;
        config.eds.own_deformation = false;
        config.camera_colour.enabled = true;
        config.camera_pose.enabled = true;
        config.camera_time.enabled = true;
        // Three renderings a frame cost more than they bring in so few iterations (lab/notebook/scene-needs.md).
        config.blur = BlurConfig { model: Switch::Off, samples: 3, one_gradient: true, instant: None };
        config.dynamic.skip_static = true;
        config.dynamic.whole_image_every = 4;
        config
    }
}

impl Default for Config {
    fn default() -> Self {
        Self::preset(Method::ErfGs, Preset::Default)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_baseline_knows_neither_events_nor_exposures() {
        for preset in [Preset::Paper, Preset::ReleasedCode, Preset::Default] {
            let config = Config::preset(Method::FourDgs, preset);
            assert!(!config.earl.enabled && !config.eds.enabled && config.blur.model == Switch::Off);
        }
    }

    #[test]
    fn every_preset_survives_a_round_trip_through_toml() {
        for preset in [Preset::Paper, Preset::ReleasedCode, Preset::Default] {
            let config = Config::preset(Method::ErfGs, preset);
            let text = config.to_toml().expect("serialises");
            assert_eq!(Config::from_toml(&text).expect("parses"), config);
        }
    }
}
