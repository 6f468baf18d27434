use std::{fs, io::Write, process::Command};

use erfgs_scene::image::ImageRgb8;
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

/// The same frames as numbered pictures, and as a video without loss at so many frames a second.
fn write_pictures(folder: &Folder, levels: &[u8], [width, height]: [u32; 2], fps: u32) {
    for (index, levels) in levels.chunks_exact((width * height) as usize).enumerate() {
        let data = levels.iter().flat_map(|&level| [level; 3]).collect();
        // Names in the order of their numbers are not in that of the alphabet.
        ImageRgb8 { width, height, data }.write_png(&folder.path(&format!("pictures/{index}.png"))).expect("written");
    }
    let (rate, pictures) = (fps.to_string(), folder.path("pictures/%d.png"));
    let mut ffmpeg = Command::new("ffmpeg");
    ffmpeg.args(["-v", "error", "-framerate", &rate, "-i"]).arg(pictures).args(["-c:v", "ffv1", "-pix_fmt", "bgr0"]);
    assert!(ffmpeg.arg(folder.path("video.mkv")).status().expect("ffmpeg").success());
}

#[test]
fn videos_and_pictures_give_the_events_of_their_grey_levels_in_every_format() {
    let folder = Folder::new();
    let levels = luma(12, 24, 16);
    write_luma(&folder, "luma.npz", &levels, "12, 16, 24");
    write_pictures(&folder, &levels, [24, 16], 50);
    folder.succeed("simulate luma.npz --fps 50 --out luma.csv");
    folder.succeed("simulate pictures --fps 50 --out pictures.csv");
    // The video knows how fast it is.
    folder.succeed("simulate video.mkv --out video.csv");
    let events = |name: &str| fs::read_to_string(folder.path(name)).expect("events");
    assert!(events("luma.csv").lines().count() > 500);
    assert!(events("luma.csv") == events("pictures.csv") && events("luma.csv") == events("video.csv"));
    // Played four times as slowly as it was recorded.
    let fast = folder.figures("simulate video.mkv --fps 200 --out fast.npz");
    let info = folder.figures("info fast.npz");
    assert_eq!(info["events"], fast["events"]);
    let last = |name: &str| {
        let text = events(name);
        let last = text.lines().last().and_then(|line| line.split(',').next());
        last.expect("a time").parse::<f64>().expect("a number")
    };
    folder.succeed("export fast.npz --to csv --out fast.csv");
    assert!((last("video.csv") / last("fast.csv") - 4.0).abs() < 0.01);
    for name in ["events.raw", "events.dat", "events.aedat4", "events.npz"] {
        let made = folder.figures(&format!("simulate video.mkv --out {name}"));
        assert_eq!(folder.figures(&format!("info {name}"))["events"], made["events"], "{name}");
    }

    assert!(folder.fail(2, "simulate pictures --out none.npz").contains("--fps"));
    assert!(folder.fail(2, "simulate video.mkv --out none.txt").contains(".aedat4"));
    fs::create_dir(folder.path("empty")).expect("a folder");
    assert!(folder.fail(2, "simulate empty --fps 5 --out none.npz").contains("no PNG or JPEG"));
    fs::write(folder.path("broken.mp4"), "no video").expect("written");
    assert!(folder.fail(1, "simulate broken.mp4 --out none.npz").contains("broken.mp4"));
    ImageRgb8::new(8, 8).write_png(&folder.path("pictures/12.png")).expect("written");
    let odd = folder.fail(2, "simulate pictures --fps 5 --out none.npz");
    assert!(odd.contains("12.png has 8 x 8") && odd.contains("24 x 16"), "{odd}");
    assert!(!folder.path("none.npz").exists());
}
