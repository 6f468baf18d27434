//! How many bits of a video's samples count.

use std::{ffi::OsString, path::Path, process::Command};

use erfgs_base::children;

use super::PATIENCE;

/// Whether a video has samples of 16 bits, of which fewer may count; by ffprobe. What cannot be told has none.
pub(super) fn has_samples_of_16_bits(path: &Path) -> bool {
    let mut input = OsString::from("file:");
    input.push(path);
    let mut command = Command::new("ffprobe");
    command
        .args(["-v", "quiet", "-select_streams", "v:0", "-show_entries", "stream=pix_fmt"])
        .args(["-of", "default=noprint_wrappers=1:nokey=1"])
        .arg(input);
    let mut pixel_format = String::new();
    let keep = |line: &str| {
        if pixel_format.is_empty() {
            line.trim().clone_into(&mut pixel_format);
        }
    };
    children::run(command, PATIENCE, keep).is_ok() && is_of_16_bits(&pixel_format)
}

/// Whether a pixel format of ffmpeg has samples of 16 bits: `gray16le`, `rgb48be`, `rgba64le`, `yuv444p16le`, `bayer_rggb16le`.
fn is_of_16_bits(format: &str) -> bool {
    let name = format.trim_end_matches("le").trim_end_matches("be");
    name.ends_with("16") || name.ends_with("48") || name.ends_with("64")
}

/// Samples of 16 bits, high byte first, as levels of 8 bits, `white` being the largest that counts. Gives the largest sample, too.
pub(super) fn levels(samples: &[u8], white: u32) -> (Vec<u8>, u16) {
    let mut most = 0;
    let level = |&sample: &[u8; 2]| {
        let sample = u16::from_be_bytes(sample);
        most = sample.max(most);
        ((u32::from(sample) * 255 + white / 2) / white).min(255) as u8
    };
    let levels = samples.as_chunks::<2>().0.iter().map(level).collect();
    (levels, most)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn formats_of_16_bits_are_known_by_their_names() {
        for name in ["gray16le", "gray16be", "rgb48le", "bgr48be", "rgba64le", "gbrp16le", "yuv444p16le", "ya16be"] {
            assert!(is_of_16_bits(name), "{name}");
        }
        for name in
            ["gray", "gray10le", "gray12be", "yuv420p", "yuv420p10le", "gbrp12le", "rgb24", "nv12", "p010le", ""]
        {
            assert!(!is_of_16_bits(name), "{name}");
        }
    }
}
