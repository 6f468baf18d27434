use std::path::Path;

use erfgs_calibrate::board::{BoardOptions, calibrate, look, look_session};
use erfgs_scene::pixel::PixelFormat;
use erfgs_session::{
    container::{Session, SessionStart, SessionWriter, Settings},
    source::{Description, Encoding, Packet},
};

use super::chessboards::{folder, target};

/// The stereo pairs as two cameras recorded them, ten a second, the right one 3 ms later; as JPEG files.
pub fn record(path: &Path) {
    let start =
        SessionStart { host_ns: 7_000_000_000, epoch_ns: 0, program: "test".into(), machine: Default::default() };
    let mut writer = SessionWriter::create(path, start, "", Settings::default()).unwrap();
    let mut files: Vec<_> = std::fs::read_dir(folder()).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.retain(|file| file.extension().is_some_and(|extension| extension == "jpg"));
    files.sort();
    for (camera, late) in [("left", 0), ("right", 3_000_000)] {
        let stream = writer
            .add_stream(&Description {
                id: camera.into(),
                model: "camera".into(),
                serial: String::new(),
                encoding: Encoding::Frames(PixelFormat::Mjpeg),
                width: 640,
                height: 480,
                start_order: 0,
                settings: serde_json::Map::new(),
            })
            .unwrap();
        let own = files.iter().filter(|file| file.to_string_lossy().contains(&format!("/{camera}")));
        for (sequence, file) in (0..).zip(own) {
            let packet = Packet {
                sequence,
                host_ns: 7_000_000_000 + sequence as i64 * 100_000_000 + late,
                discontinuity: false,
                damaged: false,
                stamp: None,
                payload: std::fs::read(file).unwrap().into(),
            };
            writer.packet(stream, &packet).unwrap();
        }
    }
    writer.finish().unwrap();
}

#[test]
fn the_streams_of_a_session_give_what_their_pictures_give() {
    let temporary = tempfile::tempdir().unwrap();
    let path = temporary.path().join("s.mcap");
    record(&path);
    let of_session = look_session(&mut Session::open(&path).unwrap(), &target(), None, None, &|_, _| {}).unwrap();
    let of_files = look(&folder(), &target(), None, &|_, _| {}).unwrap();
    for (a, b) in of_session.iter().zip(&of_files) {
        assert_eq!((&a.camera, a.frames, a.size), (&b.camera, b.frames, b.size));
        assert!(a.views.iter().zip(&b.views).all(|(a, b)| a.corners == b.corners));
    }
    // Without times, so that the same problem is solved.
    let mut still = of_session.clone();
    still.iter_mut().flat_map(|seen| &mut seen.views).for_each(|view| view.time_s = None);
    let solve = |seen| calibrate(seen, &target(), &BoardOptions::default(), &|_, _, _| {}).unwrap().0;
    let (a, b) = (solve(&still), solve(&of_files));
    let apart = (a.cameras[1].pose.unwrap().centre() - b.cameras[1].pose.unwrap().centre()).length();
    assert!(apart < 1e-6, "{apart}");
    let unasked = Session::open(&folder().join("left01.jpg"));
    assert!(unasked.err().unwrap().to_string().contains("left01.jpg"));
}
