use erfgs_scene::{Distortion, Intrinsics, Pose};

use super::*;

/// The tables of COLMAP 3.8.
const SCHEMA_3_8: &str = "
    CREATE TABLE cameras (camera_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, model INTEGER NOT NULL,
        width INTEGER NOT NULL, height INTEGER NOT NULL, params BLOB, prior_focal_length INTEGER NOT NULL);
    CREATE TABLE images (image_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, name TEXT NOT NULL UNIQUE,
        camera_id INTEGER NOT NULL, prior_qw REAL, prior_qx REAL, prior_qy REAL, prior_qz REAL, prior_tx REAL,
        prior_ty REAL, prior_tz REAL);
    CREATE TABLE keypoints (image_id INTEGER PRIMARY KEY NOT NULL, rows INTEGER NOT NULL, cols INTEGER NOT NULL,
        data BLOB);
    CREATE TABLE descriptors (image_id INTEGER PRIMARY KEY NOT NULL, rows INTEGER NOT NULL, cols INTEGER NOT NULL,
        data BLOB);
    CREATE TABLE matches (pair_id INTEGER PRIMARY KEY NOT NULL, rows INTEGER NOT NULL, cols INTEGER NOT NULL,
        data BLOB);
    CREATE TABLE two_view_geometries (pair_id INTEGER PRIMARY KEY NOT NULL, rows INTEGER NOT NULL,
        cols INTEGER NOT NULL, data BLOB, config INTEGER NOT NULL, F BLOB, E BLOB, H BLOB, qvec BLOB, tvec BLOB);";

/// What 4.x has more in the same tables.
const MORE_IN_4: &str = "
    ALTER TABLE descriptors ADD COLUMN type INTEGER NOT NULL DEFAULT 0;
    ALTER TABLE two_view_geometries ADD COLUMN camera1 BLOB;
    ALTER TABLE two_view_geometries ADD COLUMN camera2 BLOB;";

fn made(extra: &str) -> (tempfile::TempDir, Database) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("database.db");
    let connection = Connection::open(&path).unwrap();
    connection.execute_batch(SCHEMA_3_8).unwrap();
    connection.execute_batch(extra).unwrap();
    connection
        .execute_batch(
            "INSERT INTO cameras VALUES (1, 2, 10, 10, NULL, 0), (2, 2, 10, 10, NULL, 0);
             INSERT INTO images (image_id, name, camera_id) VALUES (3, 'b/0.png', 2), (1, 'a/0.png', 1);",
        )
        .unwrap();
    (folder, Database::open(&path).unwrap())
}

fn keypoints(database: &Database, image: u32, rows: i64, columns: i64, data: &[f32]) {
    let blob: Vec<u8> = data.iter().flat_map(|number| number.to_le_bytes()).collect();
    let query = "INSERT INTO keypoints VALUES (?1, ?2, ?3, ?4)";
    database.connection.execute(query, params![image, rows, columns, blob]).unwrap();
}

fn descriptors(database: &Database, image: u32, rows: i64, columns: i64, data: &[u8]) {
    let query = "INSERT INTO descriptors (image_id, rows, cols, data) VALUES (?1, ?2, ?3, ?4)";
    database.connection.execute(query, params![image, rows, columns, data]).unwrap();
}

fn relative() -> Relative {
    let k = Intrinsics { width: 4, height: 4, fx: 2.0, fy: 2.0, cx: 2.0, cy: 2.0, distortion: Distortion::None };
    let other = Pose { translation: DVec3::new(0.5, 0.25, -1.0), ..Pose::IDENTITY };
    Relative::new((&k, &Pose::IDENTITY), (&k, &other))
}

#[test]
fn images_come_ordered_by_id() {
    let (_folder, database) = made("");
    let rows = database.images().unwrap();
    assert_eq!(rows.iter().map(|row| (row.image, row.camera)).collect::<Vec<_>>(), [(1, 1), (3, 2)]);
    assert_eq!(rows[1].name, "b/0.png");
}

#[test]
fn a_camera_is_replaced_by_the_known_pinhole() {
    let (_folder, database) = made("");
    let k = Intrinsics { width: 1280, height: 720, fx: 9.5, fy: 9.25, cx: 6.5, cy: 3.75, distortion: Distortion::None };
    database.set_camera(2, &ColmapCamera::from_intrinsics(&k), true).unwrap();
    let (model, width, blob, prior): (i64, i64, Vec<u8>, i64) = database
        .connection
        .query_row("SELECT model, width, params, prior_focal_length FROM cameras WHERE camera_id = 2", [], |row| {
            Ok((row.get(0)?, row.get(1)?, row.get(2)?, row.get(3)?))
        })
        .unwrap();
    assert_eq!((model, width, prior), (1, 1280, 1));
    assert_eq!(blob, [9.5_f64, 9.25, 6.5, 3.75].map(f64::to_le_bytes).concat());
    assert!(
        database
            .set_camera(9, &ColmapCamera::from_intrinsics(&k), true)
            .unwrap_err()
            .to_string()
            .contains("no camera 9")
    );
}

#[test]
fn features_are_read_with_any_number_of_keypoint_columns() {
    for columns in [2_usize, 4, 6] {
        let (_folder, database) = made(MORE_IN_4);
        let mut data = vec![0.0_f32; 2 * columns];
        (data[0], data[1], data[columns], data[columns + 1]) = (1.5, 2.5, 7.0, 8.0);
        keypoints(&database, 1, 2, columns as i64, &data);
        descriptors(&database, 1, 2, 128, &[3; 256]);
        assert_eq!(database.keypoints(1).unwrap().positions.len(), 2);
        assert_eq!(database.keypoints(3).unwrap().positions.len(), 0, "an image without rows has no features");
    }
}

#[test]
fn malformed_features_are_errors_that_name_the_image() {
    let wrong = |fill: &dyn Fn(&Database)| {
        let (_folder, database) = made("");
        fill(&database);
        database.keypoints(1).unwrap_err().to_string()
    };
    let message = wrong(&|database| keypoints(database, 1, 3, 2, &[1.0; 4]));
    assert!(message.contains("image 1: 3 x 2 keypoints in 16 bytes"), "{message}");
    let message = wrong(&|database| {
        keypoints(database, 1, 1, 2, &[1.0; 2]);
        descriptors(database, 1, 1, 64, &[0; 64]);
    });
    assert!(message.contains("64 bytes each"), "{message}");
    let message = wrong(&|database| keypoints(database, 1, 1, 2, &[1.0; 2]));
    assert!(message.contains("1 keypoints but 0 descriptors"), "{message}");
}

#[test]
fn matches_replace_what_was_there_in_either_schema() {
    for schema in ["", MORE_IN_4] {
        let (_folder, mut database) = made(schema);
        let pair = PairMatches { images: [1, 3], matches: vec![[5, 6], [7, 8]], relative: relative() };
        database.write_matches(&[pair.clone(), PairMatches { images: [1, 2], ..pair.clone() }]).unwrap();
        database.write_matches(&[pair]).unwrap();
        for table in ["matches", "two_view_geometries"] {
            let query = format!("SELECT pair_id, rows, cols, data FROM {table}");
            let mut statement = database.connection.prepare(&query).unwrap();
            let rows: Vec<(i64, i64, i64, Vec<u8>)> = statement
                .query_map([], |row| Ok((row.get(0)?, row.get(1)?, row.get(2)?, row.get(3)?)))
                .unwrap()
                .collect::<Result<_, _>>()
                .unwrap();
            let data = [5_u32, 6, 7, 8].map(u32::to_le_bytes).concat();
            assert_eq!(rows, [(2_147_483_647 + 3, 2, 2, data)], "{table}");
        }
        let (config, essential, tvec): (i64, Vec<u8>, Vec<u8>) = database
            .connection
            .query_row("SELECT config, E, tvec FROM two_view_geometries", [], |row| {
                Ok((row.get(0)?, row.get(1)?, row.get(2)?))
            })
            .unwrap();
        assert_eq!(config, 2);
        assert_eq!(tvec, [0.5_f64, 0.25, -1.0].map(f64::to_le_bytes).concat());
        // E = [t]x, row by row.
        let rows = [0.0_f64, 1.0, 0.25, -1.0, 0.0, -0.5, -0.25, 0.5, 0.0];
        let numbers: Vec<f64> = essential.as_chunks::<8>().0.iter().map(|bytes| f64::from_le_bytes(*bytes)).collect();
        assert_eq!(numbers, rows);
    }
}

#[test]
fn a_file_that_is_no_database_is_an_error_that_names_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("nothing.db");
    let message = Database::open(&path).err().unwrap().to_string();
    assert!(message.contains("nothing.db"), "{message}");
    std::fs::write(&path, "no database at all, but long enough to be looked at as one".repeat(20)).unwrap();
    let message = Database::open(&path).unwrap().images().unwrap_err().to_string();
    assert!(message.contains("nothing.db") && message.contains("reading the images"), "{message}");
}
