use std::{fs, io::Write};

use zip::{ZipWriter, write::SimpleFileOptions};

use crate::command_line::Folder;

/// A bright square that moves over a grey ground.
fn luma(frames: u64, width: u64, height: u64) -> Vec<u8> {
    (0..frames)
        .flat_map(|t| (0..height).flat_map(move |y| (0..width).map(move |x| (t, x, y))))
        .map(|(t, x, y)| if (t..t + 6).contains(&x) && (4..9).contains(&y) { 220 } else { 60 })
        .collect()
}

/// An archive with one NumPy array of bytes.
fn write_luma(folder: &Folder, name: &str, data: &[u8], shape: &str) {
    let mut header = format!("{{'descr': '|u1', 'fortran_order': False, 'shape': ({shape}), }}");
    // Magic, version, length and header together are a multiple of 64.
    let padded = (10 + header.len() + 1).next_multiple_of(64) - 10;
    header.extend(std::iter::repeat_n(' ', padded - 1 - header.len()));
    header.push('\n');
    let mut archive = ZipWriter::new(fs::File::create(folder.path(name)).expect("an archive"));
    archive.start_file("luma.npy", SimpleFileOptions::default()).expect("an entry");
    archive.write_all(b"\x93NUMPY\x01\x00").expect("written");
    archive.write_all(&(header.len() as u16).to_le_bytes()).expect("written");
    archive.write_all(header.as_bytes()).expect("written");
    archive.write_all(data).expect("written");
    archive.finish().expect("written");
}

#[test]
fn a_moving_square_makes_on_events_ahead_and_off_events_behind() {
    let folder = Folder::new();
    write_luma(&folder, "luma.npz", &luma(10, 24, 16), "10, 16, 24");
    let made = folder.figures(
        "simulate luma.npz --fps 30 --mode parity --threshold 0.2 --sigma 0 --cutoff-hz 0 --leak-hz 0 --shot-hz 0 \
         --refractory-s 0 --out events.npz",
    );
    // ln(220/60) / 0.2 = 6.5: six events a pixel for each of 5 rows and 9 steps. A pixel that darkens again gives back
    // at most as many.
    assert_eq!(made["on"].as_u64(), Some(6 * 5 * 9), "{made}");
    assert!(made["off"].as_u64() > Some(5 * 5 * 9) && made["off"].as_u64() <= Some(7 * 5 * 9), "{made}");
    let info = folder.figures("info events.npz");
    assert_eq!((info["events"].as_u64(), info["width"].as_u64()), (made["events"].as_u64(), Some(24)), "{info}");

    let noisy = "simulate luma.npz --fps 30 --simulator noisy --mode enhanced --shot-hz 100 --seed 5 --out";
    for out in ["a.npz", "b.npz"] {
        folder.succeed(&format!("{noisy} {out}"));
    }
    let [a, b] = ["a.npz", "b.npz"].map(|name| fs::read(folder.path(name)).expect("events"));
    assert!(a == b, "the same seed gives the same bytes");
    assert!(a != fs::read(folder.path("events.npz")).expect("events"));
}

#[test]
fn a_video_that_is_none_is_refused() {
    let folder = Folder::new();
    fs::write(folder.path("text.npz"), "no archive").expect("written");
    write_luma(&folder, "flat.npz", &[0; 12], "12,");
    for name in ["text.npz", "flat.npz"] {
        let stderr = folder.fail(1, &format!("simulate {name} --fps 30 --out out.npz"));
        assert!(stderr.contains(name), "{stderr}");
    }
    assert!(!folder.path("out.npz").exists());
}
