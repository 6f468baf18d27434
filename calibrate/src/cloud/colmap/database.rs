//! COLMAP's SQLite database: what this crate reads from it and writes into it.
//!
//! Works on the schemas of 3.8 and 4.x: the tables used here have the same columns in both, save that 4.x has more in
//! `descriptors` and `two_view_geometries`, all of which may be null or are already filled in.

use std::path::{Path, PathBuf};

use erfgs_session::Intrinsics;
use glam::{DMat3, DQuat, DVec2, DVec3};
use rusqlite::{Connection, params};

use super::matching::{DESCRIPTOR, Features, Relative};
use crate::cloud::CloudError;

/// COLMAP's number of the model with fx, fy, cx, cy.
const PINHOLE: i64 = 1;
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
    pub fn open(path: &Path) -> Result<Self, CloudError> {
        let flags = rusqlite::OpenFlags::SQLITE_OPEN_READ_WRITE | rusqlite::OpenFlags::SQLITE_OPEN_NO_MUTEX;
        let connection = Connection::open_with_flags(path, flags).map_err(|error| CloudError::Database {
            doing: "opening",
            path: path.to_owned(),
            why: error.to_string(),
        })?;
        Ok(Self { path: path.to_owned(), connection })
    }

    fn error(&self, doing: &'static str, why: impl ToString) -> CloudError {
        CloudError::Database { doing, path: self.path.clone(), why: why.to_string() }
    }

    /// All images, ordered by id.
    pub fn images(&self) -> Result<Vec<ImageRow>, CloudError> {
        let read = || -> rusqlite::Result<Vec<ImageRow>> {
            let mut statement =
                self.connection.prepare("SELECT image_id, camera_id, name FROM images ORDER BY image_id")?;
            statement
                .query_map([], |row| Ok(ImageRow { image: row.get(0)?, camera: row.get(1)?, name: row.get(2)? }))?
                .collect()
        };
        read().map_err(|error| self.error("reading the images", error))
    }

    /// Replaces a camera by the pinhole of `intrinsics`, whose focal length COLMAP shall trust.
    pub fn set_pinhole(&self, camera: u32, intrinsics: &Intrinsics) -> Result<(), CloudError> {
        let blob = f64_bytes([intrinsics.fx, intrinsics.fy, intrinsics.cx, intrinsics.cy]);
        let changed = self
            .connection
            .execute(
                "UPDATE cameras SET model = ?1, width = ?2, height = ?3, params = ?4, prior_focal_length = 1 \
                 WHERE camera_id = ?5",
                params![PINHOLE, intrinsics.width, intrinsics.height, blob, camera],
            )
            .map_err(|error| self.error("writing the intrinsics", error))?;
        if changed == 1 { Ok(()) } else { Err(self.error("writing the intrinsics", format!("no camera {camera}"))) }
    }

    /// The features of an image; none if extraction found none. The image has `width` x `height` pixels.
    pub fn features(&self, image: u32, width: u32, height: u32) -> Result<Features, CloudError> {
        let points = match self.blob("keypoints", image)? {
            None => Vec::new(),
            Some((rows, columns, data)) => {
                if columns < 2 || data.len() != rows * columns * 4 {
                    let bytes = data.len();
                    let why = format!("image {image}: {rows} x {columns} keypoints in {bytes} bytes");
                    return Err(self.error("reading keypoints", why));
                }
                let number = |bytes: &[u8]| f64::from(f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]));
                data.chunks_exact(columns * 4).map(|row| DVec2::new(number(&row[..4]), number(&row[4..8]))).collect()
            }
        };
        let descriptors = match self.blob("descriptors", image)? {
            None => Vec::new(),
            Some((rows, columns, data)) => {
                let (whole, rest) = data.as_chunks::<DESCRIPTOR>();
                if columns != DESCRIPTOR || !rest.is_empty() || whole.len() != rows {
                    let why = format!("image {image}: {columns} bytes each, where SIFT has {DESCRIPTOR}");
                    return Err(self.error("reading descriptors", why));
                }
                whole.to_vec()
            }
        };
        if points.len() != descriptors.len() {
            let why = format!("image {image}: {} keypoints but {} descriptors", points.len(), descriptors.len());
            return Err(self.error("reading features", why));
        }
        Ok(Features::new(width, height, points, descriptors))
    }

    /// Rows, columns and data of an image's row in `table`.
    fn blob(&self, table: &str, image: u32) -> Result<Option<(usize, usize, Vec<u8>)>, CloudError> {
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
    pub fn write_matches(&mut self, pairs: &[PairMatches]) -> Result<(), CloudError> {
        let path = self.path.clone();
        write_matches(&mut self.connection, pairs).map_err(|error| CloudError::Database {
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
            let [a, b] = pair.images.map(i64::from);
            let id = MAX_IMAGES * a + b;
            let data: Vec<u8> = pair.matches.as_flattened().iter().flat_map(|index| index.to_le_bytes()).collect();
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
