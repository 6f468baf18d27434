//! Reading, writing and overriding a configuration.

use erfgs_dataset::Dataset;

use super::{Config, FreeTimeOptions, Guide, Method, MotionModel, ranges};
use crate::scene::{SceneError, check_memory, exposed, extent, moves, stands_still};
use erfgs_splat::motion::FAR;

/// The near plane is at most this share of the scene's extent away.
const NEAREST: f32 = 0.2;
/// Where exposures leave less unseen than this share of the picture's width from frame to frame, frames tell of paths.
const LITTLE: f64 = 0.01;
/// Where velocities change by less than this share of the speed from frame to frame, in the median, so do they. Pairs of chance have 1.41.
const STRAIGHT: f64 = 1.1;
/// The same beside events, which tell of what bends.
const STRAIGHT_BESIDE_EVENTS: f64 = 0.9;

/// Why a configuration was refused.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// The text is not a configuration.
    #[error("the configuration could not be read: {0}")]
    Parse(#[from] toml::de::Error),
    /// The configuration could not be written.
    #[error("the configuration could not be written: {0}")]
    Write(#[from] toml::ser::Error),
    /// An override is not `key=value`.
    #[error("'{0}' is not of the form key=value (for example density.every=200)")]
    NotAnAssignment(String),
    /// No such field.
    #[error("there is no field '{key}' in the configuration; its fields are listed in config.toml of any run")]
    UnknownKey {
        /// The key that was asked for.
        key: String,
    },
    /// Paths cannot be so.
    #[error(transparent)]
    Path(#[from] erfgs_splat::motion::PathError),
    /// A value makes no sense.
    #[error("{key} = {value} is out of range: {reason}")]
    OutOfRange {
        /// The field.
        key: &'static str,
        /// Its value.
        value: String,
        /// What is allowed.
        reason: String,
    },
}

impl Config {
    /// The configuration as TOML.
    ///
    /// # Errors
    /// [`ConfigError::Write`].
    pub fn to_toml(&self) -> Result<String, ConfigError> {
        Ok(toml::to_string_pretty(self)?)
    }

    /// A configuration from TOML; every field must be there.
    ///
    /// # Errors
    /// [`ConfigError::Parse`], [`ConfigError::OutOfRange`].
    pub fn from_toml(text: &str) -> Result<Self, ConfigError> {
        let config: Self = toml::from_str(text)?;
        config.validate()?;
        Ok(config)
    }

    /// Sets one field by its dotted name, as in `density.every=200`.
    ///
    /// # Errors
    /// [`ConfigError::NotAnAssignment`], [`ConfigError::UnknownKey`], [`ConfigError::Parse`].
    pub fn set(&mut self, assignment: &str) -> Result<(), ConfigError> {
        let (key, value) = assignment.split_once('=').ok_or_else(|| ConfigError::NotAnAssignment(assignment.into()))?;
        let (key, value) = (key.trim(), value.trim());
        let mut root = toml::Table::try_from(&*self)?;
        // A bare word is a string, so that `earl.norm=l2` needs no quotes.
        let parse = |text: &str| toml::from_str::<toml::Table>(&format!("v = {text}")).ok();
        let parsed = parse(value).or_else(|| parse(&format!("{value:?}")));
        let mut value = parsed
            .and_then(|mut table| table.remove("v"))
            .ok_or_else(|| ConfigError::NotAnAssignment(assignment.into()))?;
        let unknown = || ConfigError::UnknownKey { key: key.into() };
        let (path, field) = key.rsplit_once('.').map_or((None, key), |(path, field)| (Some(path), field));
        let mut table = &mut root;
        for part in path.into_iter().flat_map(|path| path.split('.')) {
            table = table.get_mut(part).and_then(toml::Value::as_table_mut).ok_or_else(unknown)?;
        }
        match table.get(field) {
            Some(toml::Value::Float(_)) => {
                if let toml::Value::Integer(whole) = value {
                    value = toml::Value::Float(whole as f64);
                }
            }
            Some(_) => {}
            // The one field that may be absent.
            None if key == "blur.instant" => {}
            None => return Err(unknown()),
        }
        table.insert(field.into(), value);
        let config: Self = root.try_into()?;
        config.validate()?;
        *self = config;
        Ok(())
    }

    /// Decides what was left to the data: how things move and, with it, which instant a frame stands for, what paths are fitted
    /// to and how long Gaussians live; and brings the near plane closer where the scene is small. `without_points` says that the
    /// dataset's points are not used.
    ///
    /// # Errors
    /// [`SceneError`] where this machine has not the memory that the cameras take; where the manifest tells the instants of its points in
    /// a way that cannot be, or their file is damaged; where no point is known to move, the same of the frames and events that are then
    /// looked at.
    pub fn settle(&mut self, dataset: &Dataset, without_points: bool) -> Result<(), SceneError> {
        check_memory(dataset, self)?;
        if self.motion == MotionModel::Auto {
            let moving = !without_points && dataset.point_runs()?.is_some_and(|runs| runs.iter().any(|run| run.moving));
            let bodies = dataset.manifest.bodies.as_ref().is_some_and(|file| file.count > 0);
            self.motion = if moving && bodies && self.method == Method::ErfGs {
                // Whoever had them found wants them; a trial leaves free in time what is none.
                MotionModel::Bodies
            } else if moving {
                MotionModel::FreeTime
            } else if stands_still(dataset, &self.dynamic)? {
                MotionModel::Still
            } else {
                MotionModel::HexPlane
            };
        }
        if matches!(self.motion, MotionModel::FreeTime | MotionModel::Bodies) {
            // Gaussians are born where things were in the middle of an exposure.
            self.blur.instant = self.blur.instant.or(Some(0.5));
        }
        let extent = extent(dataset, without_points)?;
        let undecided = self.free_time.guide == Guide::Auto || self.free_time.first_life == 0.0;
        let moved = match self.motion {
            MotionModel::FreeTime | MotionModel::Bodies if undecided && !without_points => {
                moves(dataset, self.free_time.fastest * extent)?
            }
            _ => None,
        };
        let by_hand = self.paths_by_hand();
        if self.free_time.guide == Guide::Auto {
            let frames_suffice = moved.is_some_and(|moves| {
                let little = moves.displacement * (1.0 - exposed(dataset)) < LITTLE;
                let straight = if self.earl.enabled { STRAIGHT_BESIDE_EVENTS } else { STRAIGHT };
                little || moves.displacement <= FAR && moves.bend.is_some_and(|bend| bend < straight)
            });
            self.free_time.guide = if frames_suffice && !by_hand { Guide::Frames } else { Guide::Events };
        }
        if self.free_time.guide == Guide::Frames && !by_hand {
            self.free_time.follow_frames();
        }
        if self.free_time.first_life == 0.0 {
            // Without events nothing is between frames but what outlives one.
            self.free_time.live(moved.map(|moves| moves.displacement).filter(|_| self.earl.enabled));
        }
        if extent > 0.0 {
            self.near_m = self.near_m.min(NEAREST * extent);
        }
        Ok(())
    }

    /// Whether a setting that [`Guide`] decides is another than the preset has it.
    fn paths_by_hand(&self) -> bool {
        let preset = Self::preset(self.method, self.preset).free_time;
        let paths = |free: &FreeTimeOptions| (free.knots, free.first_life, free.least_life);
        paths(&self.free_time) != paths(&preset)
    }

    /// Whether every number makes sense: each is within its range, and fits the others.
    ///
    /// # Errors
    /// [`ConfigError::OutOfRange`] names the first that does not.
    pub fn validate(&self) -> Result<(), ConfigError> {
        ranges::check(self)?;
        let check = |good: bool, key: &'static str, value: String, reason: &str| {
            if good { Ok(()) } else { Err(ConfigError::OutOfRange { key, value, reason: reason.into() }) }
        };
        let free = &self.free_time;
        check(self.near_share < 1.0, "near_share", self.near_share.to_string(), "0 to below 1")?;
        check(self.bodies.follow < 1.0, "bodies.follow", self.bodies.follow.to_string(), "0 or more, and less than 1")?;
        for (key, opacity) in [
            ("init.opacity", self.init.opacity),
            ("free_time.opacity", free.opacity),
            ("bodies.opacity", self.bodies.opacity),
        ] {
            check(opacity > 0.0 && opacity < 1.0, key, opacity.to_string(), "between 0 and 1")?;
        }
        for (key, above) in [
            ("camera_pose.within", self.camera_pose.within),
            ("camera_time.within", self.camera_time.within),
            ("free_time.fastest", free.fastest),
        ] {
            check(above > 0.0, key, above.to_string(), "above 0")?;
        }
        check(!self.field.levels.is_empty(), "field.levels", "[]".into(), "one or more, each 1 to 16")?;
        let features = self.field.features;
        check(features.is_multiple_of(4), "field.features", features.to_string(), "a multiple of 4 up to 64")?;
        check(
            free.first_life == 0.0 || free.first_life > free.least_life,
            "free_time.first_life",
            free.first_life.to_string(),
            "0, or more than free_time.least_life",
        )?;
        Ok(free.check_path()?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Norm;

    #[test]
    fn a_field_is_set_by_its_dotted_name() {
        let mut config = Config::default();
        config.set("density.every=250").expect("a number");
        config.set("earl.norm=l2").expect("a bare word");
        config.set("earl.weight=1").expect("a whole number for a float");
        config.set("field.levels=[1, 2, 4]").expect("a list");
        config.set("blur.instant=0.5").expect("an optional field");
        config.set("motion=free-time").expect("a model");
        assert_eq!(config.motion, MotionModel::FreeTime);
        config.set("motion=hexplane").expect("a model");
        assert_eq!((config.density.every, config.earl.norm, config.earl.weight), (250, Norm::L2, 1.0));
        assert_eq!((config.field.levels, config.blur.instant), (vec![1, 2, 4], Some(0.5)));
    }

    #[test]
    fn a_configuration_from_before_there_were_motion_models_is_of_the_field() {
        let text = Config::default().to_toml().expect("text");
        let mut table: toml::Table = toml::from_str(&text).expect("a table");
        table.remove("motion").expect("a field");
        table.remove("free_time").expect("a section");
        let old = toml::to_string(&table).expect("text");
        let free_time = erfgs_splat::motion::FreeTimeOptions::default();
        let of_the_field = Config { motion: MotionModel::HexPlane, free_time, ..Config::default() };
        assert_eq!(Config::from_toml(&old).expect("read"), of_the_field);
    }

    #[test]
    fn a_wrong_name_or_value_is_refused_and_changes_nothing() {
        let mut config = Config::default();
        let before = config.clone();
        assert!(matches!(config.set("density.evry=1"), Err(ConfigError::UnknownKey { .. })));
        assert!(matches!(config.set("nothing"), Err(ConfigError::NotAnAssignment(_))));
        assert!(matches!(config.set("batch=0"), Err(ConfigError::OutOfRange { .. })));
        assert!(config.set("earl.norm=l7").is_err());
        assert!(config.set("motion=sideways").is_err());
        assert!(config.set("free_time.first_life=0.25").is_err(), "not shorter than the least");
        assert!(config.set("free_time.life=nan").is_err());
        assert_eq!(config, before);
    }
}
