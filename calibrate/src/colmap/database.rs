//! COLMAP's SQLite database: what this crate reads from it and writes into it.
//!
//! Works on the schemas of 3.8 and 4.x: the tables used here have the same columns in both, save that 4.x has more in
//! `descriptors` and `two_view_geometries`, all of which may be null or are already filled in.

use std::path::{Path, PathBuf};

use erfgs_scene::colmap::ColmapCamera;
use glam::{DMat3, DQuat, DVec2, DVec3};
use rusqlite::{Connection, params};

use super::{
    RunError,
    matching::{DESCRIPTOR, Relative},
};

/// COLMAP's number of a pair whose calibrated geometry is known.
const CALIBRATED: i64 = 2;
/// `pair_id = MAX_IMAGES * smaller image_id + larger image_id`.
const MAX_IMAGES: i64 = 2_147_483_647;

/// A row of `images`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ImageRow {
    /// `image_id`.
    pub image: u32,
    /// `camera_id`.
    pub camera: u32,
    /// Path below the image folder.
    pub name: String,
}

/// The features of an image, by index.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Keypoints {
    /// Where they are, pixels of the image that was given to COLMAP.
    pub positions: Vec<DVec2>,
    /// Their scales, pixels.
    pub scales: Vec<f64>,
    /// Their descriptors.
    pub descriptors: Vec<[u8; DESCRIPTOR]>,
}

/// The matches of a pair of images whose first has the smaller id.
#[derive(Clone, Debug)]
pub struct PairMatches {
    /// The two `image_id`s, ascending.
    pub images: [u32; 2],
    /// Indices of keypoints that belong together.
    pub matches: Vec<[u32; 2]>,
    /// The second camera's pose with respect to the first.
    pub relative: Relative,
}

/// An open database.
pub struct Database {
    path: PathBuf,
    connection: Connection,
}

impl Database {
    /// Opens the database that COLMAP's feature extraction made.
    pub fn open(path: &Path) -> Result<Self, RunError> {
        let flags = rusqlite::OpenFlags::SQLITE_OPEN_READ_WRITE | rusqlite::OpenFlags::SQLITE_OPEN_NO_MUTEX;
        let connection = Connection::open_with_flags(path, flags).map_err(|error| RunError::Database {
            doing: "opening",
            path: path.to_owned(),
            why: error.to_string(),
        })?;
        Ok(Self { path: path.to_owned(), connection })
    }

    fn error(&self, doing: &'static str, why: impl ToString) -> RunError {
        RunError::Database { doing, path: self.path.clone(), why: why.to_string() }
    }

    /// All images, ordered by id.
    pub fn images(&self) -> Result<Vec<ImageRow>, RunError> {
        let read = || -> rusqlite::Result<Vec<ImageRow>> {
            let mut statement =
                self.connection.prepare("SELECT image_id, camera_id, name FROM images ORDER BY image_id")?;
            statement
                .query_map([], |row| Ok(ImageRow { image: row.get(0)?, camera: row.get(1)?, name: row.get(2)? }))?
                .collect()
        };
        read().map_err(|error| self.error("reading the images", error))
    }

    /// Replaces a camera. `trusted`: its focal length is known, and no guess.
    pub fn set_camera(&self, camera: u32, to: &ColmapCamera, trusted: bool) -> Result<(), RunError> {
        let (width, height) = (to.width as i64, to.height as i64);
        let blob = f64_bytes(to.parameters.iter().copied());
        let changed = self
            .connection
            .execute(
                "UPDATE cameras SET model = ?1, width = ?2, height = ?3, params = ?4, prior_focal_length = ?5 \
                 WHERE camera_id = ?6",
                params![to.model.id(), width, height, blob, trusted, camera],
            )
            .map_err(|error| self.error("writing the intrinsics", error))?;
        if changed == 1 { Ok(()) } else { Err(self.error("writing the intrinsics", format!("no camera {camera}"))) }
    }

    /// The features of an image; none if extraction found none.
    pub fn keypoints(&self, image: u32) -> Result<Keypoints, RunError> {
        let mut found = Keypoints::default();
        if let Some((rows, columns, data)) = self.blob("keypoints", image)? {
            if columns < 2 || data.len() != rows * columns * 4 {
                let bytes = data.len();
                let why = format!("image {image}: {rows} x {columns} keypoints in {bytes} bytes");
                return Err(self.error("reading keypoints", why));
            }
            let number = |bytes: &[u8]| f64::from(f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]));
            for row in data.chunks_exact(columns * 4) {
                let at = |column: usize| number(&row[4 * column..4 * column + 4]);
                found.positions.push(DVec2::new(at(0), at(1)));
                // x, y, then the scale and the orientation, or the 2x2 matrix of an affine shape.
                found.scales.push(match columns {
                    2 | 3 => 1.0,
                    4 | 5 => at(2),
                    _ => at(2).hypot(at(4)),
                });
            }
        }
        if let Some((rows, columns, data)) = self.blob("descriptors", image)? {
            let (whole, rest) = data.as_chunks::<DESCRIPTOR>();
            if columns != DESCRIPTOR || !rest.is_empty() || whole.len() != rows {
                let why = format!("image {image}: {columns} bytes each, where SIFT has {DESCRIPTOR}");
                return Err(self.error("reading descriptors", why));
            }
            found.descriptors = whole.to_vec();
        }
        if found.positions.len() != found.descriptors.len() {
            let (points, descriptors) = (found.positions.len(), found.descriptors.len());
            let why = format!("image {image}: {points} keypoints but {descriptors} descriptors");
            return Err(self.error("reading features", why));
        }
        Ok(found)
    }

    /// Replaces all matches by `pairs` (ids of two images, ascending, and indices of keypoints), whose geometry is not
    /// known yet.
    pub fn write_unverified(&mut self, pairs: &[([u32; 2], Vec<[u32; 2]>)]) -> Result<(), RunError> {
        let path = self.path.clone();
        let mut write = || -> rusqlite::Result<()> {
            let transaction = self.connection.transaction()?;
            transaction.execute("DELETE FROM matches", [])?;
            transaction.execute("DELETE FROM two_view_geometries", [])?;
            {
                let mut insert =
                    transaction.prepare("INSERT INTO matches (pair_id, rows, cols, data) VALUES (?1, ?2, 2, ?3)")?;
                for (images, matches) in pairs {
                    insert.execute(params![pair_id(*images), matches.len() as i64, match_bytes(matches)])?;
                }
            }
            transaction.commit()
        };
        write().map_err(|error| RunError::Database { doing: "writing the matches", path, why: error.to_string() })
    }

    /// Rows, columns and data of an image's row in `table`.
    fn blob(&self, table: &str, image: u32) -> Result<Option<(usize, usize, Vec<u8>)>, RunError> {
        let read = || -> rusqlite::Result<Option<(usize, usize, Vec<u8>)>> {
            let query = format!("SELECT rows, cols, data FROM {table} WHERE image_id = ?1");
            let mut statement = self.connection.prepare_cached(&query)?;
            let mut rows = statement.query([image])?;
            let Some(row) = rows.next()? else { return Ok(None) };
            let data: Option<Vec<u8>> = row.get(2)?;
            Ok(Some((row.get::<_, u32>(0)? as usize, row.get::<_, u32>(1)? as usize, data.unwrap_or_default())))
        };
        read().map_err(|error| self.error("reading features", error))
    }

    /// Replaces all matches and two-view geometries by `pairs`.
    pub fn write_matches(&mut self, pairs: &[PairMatches]) -> Result<(), RunError> {
        let path = self.path.clone();
        write_matches(&mut self.connection, pairs).map_err(|error| RunError::Database {
            doing: "writing the matches",
            path,
            why: error.to_string(),
        })
    }
}

fn write_matches(connection: &mut Connection, pairs: &[PairMatches]) -> rusqlite::Result<()> {
    let transaction = connection.transaction()?;
    transaction.execute("DELETE FROM matches", [])?;
    transaction.execute("DELETE FROM two_view_geometries", [])?;
    {
        let mut matches =
            transaction.prepare("INSERT INTO matches (pair_id, rows, cols, data) VALUES (?1, ?2, 2, ?3)")?;
        let mut geometries = transaction.prepare(
            "INSERT INTO two_view_geometries (pair_id, rows, cols, data, config, F, E, H, qvec, tvec) \
             VALUES (?1, ?2, 2, ?3, ?4, ?5, ?6, ?7, ?8, ?9)",
        )?;
        for pair in pairs {
            let id = pair_id(pair.images);
            let data = match_bytes(&pair.matches);
            let rows = pair.matches.len() as i64;
            matches.execute(params![id, rows, data])?;
            let Relative { rotation, translation, essential, fundamental } = pair.relative;
            geometries.execute(params![
                id,
                rows,
                data,
                CALIBRATED,
                matrix_bytes(fundamental),
                matrix_bytes(essential),
                matrix_bytes(DMat3::IDENTITY),
                quaternion_bytes(rotation),
                vector_bytes(translation),
            ])?;
        }
    }
    transaction.commit()
}

fn pair_id(images: [u32; 2]) -> i64 {
    let [a, b] = images.map(i64::from);
    MAX_IMAGES * a + b
}

fn match_bytes(matches: &[[u32; 2]]) -> Vec<u8> {
    matches.as_flattened().iter().flat_map(|index| index.to_le_bytes()).collect()
}

fn f64_bytes(numbers: impl IntoIterator<Item = f64>) -> Vec<u8> {
    numbers.into_iter().flat_map(f64::to_le_bytes).collect()
}

/// Row-major.
fn matrix_bytes(matrix: DMat3) -> Vec<u8> {
    f64_bytes(matrix.transpose().to_cols_array())
}

/// w, x, y, z.
fn quaternion_bytes(rotation: DMat3) -> Vec<u8> {
    let q = DQuat::from_mat3(&rotation).normalize();
    f64_bytes([q.w, q.x, q.y, q.z])
}

fn vector_bytes(vector: DVec3) -> Vec<u8> {
    f64_bytes(vector.to_array())
}

#[cfg(test)]
#[path = "database_tests.rs"]
mod tests;
