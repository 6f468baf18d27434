//! Frames of a video file, decoded by ffmpeg, and videos that it encodes.
//!
//! ffmpeg is called as a program and not linked. It decodes whatever cameras write and is kept up to date against
//! damaged and hostile files by others; as a separate process it cannot bring this one down, its licence (LGPL or GPL,
//! depending on how it was built) stays apart, and nobody needs its headers to build erfgs. The price is one pipe:
//! frames arrive as PPM images, which cost less to parse than to decode.

mod depth;
mod times;
mod whole;
mod write;

use std::{
    ffi::OsStr,
    fs::File,
    io::{self, BufRead, BufReader, Read, Seek, SeekFrom},
    path::{Path, PathBuf},
    process::{ChildStdout, Command, ExitStatus, Stdio},
    time::Duration,
};

use erfgs_base::{
    FileError,
    children::{self, Piped},
};

pub use self::{times::FrameTimes, write::VideoWriter};
use crate::ImageRgb8;

/// ffmpeg and ffprobe that do nothing for so long are ended.
const PATIENCE: Duration = Duration::from_secs(60);

/// What can go wrong with a video.
#[derive(Debug, thiserror::Error)]
pub enum VideoError {
    /// There is no such file.
    #[error("the video {} does not exist", path.display())]
    Missing {
        /// The video.
        path: PathBuf,
    },
    /// ffmpeg cannot be started.
    #[error("cannot run ffmpeg to decode {}: {source}; install ffmpeg, or give the frames as folders of images", path.display())]
    NoFfmpeg {
        /// The video.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// ffmpeg gave up.
    #[error("ffmpeg cannot decode {}: {message}; check that the video is complete", path.display())]
    Decode {
        /// The video.
        path: PathBuf,
        /// What ffmpeg said.
        message: String,
    },
    /// ffmpeg cannot be started to write.
    #[error("cannot start ffmpeg, which writes MP4; install it (Debian, Ubuntu: apt install ffmpeg), or write PNG")]
    NoEncoder {
        /// Why.
        source: io::Error,
    },
    /// The folder of a video cannot be written.
    #[error(transparent)]
    File(#[from] FileError),
    /// A frame has another size than its video.
    #[error("a frame of {bytes} bytes in a video whose frames have {wanted}")]
    FrameSize {
        /// Its length.
        bytes: usize,
        /// The length of the video's frames.
        wanted: usize,
    },
    /// ffmpeg gave up writing.
    #[error("ffmpeg did not write {} ({status}): {message}", path.display())]
    Encode {
        /// The video.
        path: PathBuf,
        /// How it ended.
        status: String,
        /// What ffmpeg said.
        message: String,
    },
    /// ffmpeg said that it wrote the video, and did not.
    #[error("ffmpeg did not write all of {}: {lacking}; free some space, or choose another disk", path.display())]
    Cut {
        /// The video.
        path: PathBuf,
        /// What of it.
        lacking: &'static str,
    },
    /// The system lost hold of ffmpeg.
    #[error("cannot {what}: {source}")]
    Encoder {
        /// What was being done.
        what: &'static str,
        /// Why.
        source: io::Error,
    },
    /// A sample has more bits than are said to count.
    #[error("a sample of the video {} is {sample}, which is more than {bits} bits hold; give --bits as many as count", path.display())]
    MoreBits {
        /// The video.
        path: PathBuf,
        /// The sample.
        sample: u16,
        /// The bits that are said to count.
        bits: u8,
    },
    /// What ffmpeg sent is no PPM image.
    #[error("cannot read the frames that ffmpeg decodes from {}: {source}", path.display())]
    Pipe {
        /// The video.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
}

impl Probe {
    /// From ffprobe's lines.
    fn of(text: &str) -> Option<Self> {
        let of = |key: &str| text.lines().find_map(|line| line.trim().strip_prefix(key)?.strip_prefix('='));
        let frames = of("nb_read_packets")?.parse().ok()?;
        let rate = of("avg_frame_rate").and_then(|rate| {
            let (over, under) = rate.split_once('/')?;
            Some(over.parse::<f64>().ok()? / under.parse::<f64>().ok()?)
        });
        Some(Self { frames, rate: rate.filter(|rate| *rate > 0.0 && *rate < 1e6) })
    }
}

/// A video that is being decoded.
#[derive(Debug)]
pub struct Video {
    path: PathBuf,
    program: Piped,
    frames: BufReader<ChildStdout>,
    messages: File,
    /// Of samples of 16 bits: how many count, and the largest so far.
    words: Option<(u8, u16)>,
}

/// What a video's container says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Probe {
    /// Number of frames.
    pub frames: u64,
    /// Frames in a second, where the container says.
    pub rate: Option<f64>,
}

impl Video {
    /// How many frames the first video stream has, and at what rate, without decoding them; by ffprobe, which comes with ffmpeg.
    /// `None` where it cannot be told.
    #[must_use]
    pub fn probe(path: &Path) -> Option<Probe> {
        let mut input = std::ffi::OsString::from("file:");
        input.push(path);
        let mut command = Command::new("ffprobe");
        command
            .args(["-v", "quiet", "-select_streams", "v:0", "-count_packets", "-show_entries"])
            .args(["stream=avg_frame_rate,nb_read_packets", "-of", "default=noprint_wrappers=1"])
            .arg(input);
        let mut output = String::new();
        // It says two lines.
        let keep = |line: &str| {
            if output.len() < 4096 {
                output += line;
                output.push('\n');
            }
        };
        children::run(command, PATIENCE, keep).ok()?;
        Probe::of(&output)
    }

    /// Begins to decode the first video stream of `path`, frame by frame as stored, without making up or dropping any.
    ///
    /// # Errors
    /// If there is no such file or ffmpeg cannot be started.
    pub fn open(path: &Path) -> Result<Self, VideoError> {
        Self::open_within(OsStr::new("ffmpeg"), path, PATIENCE, None)
    }

    /// As [`Video::open`]; of samples of 16 bits, which [`Video::largest`] tells of, so many low ones count.
    ///
    /// # Errors
    /// As [`Video::open`].
    pub fn open_as(path: &Path, bits: Option<u8>) -> Result<Self, VideoError> {
        let words = (path.is_file() && depth::has_samples_of_16_bits(path)).then(|| bits.unwrap_or(16).clamp(8, 16));
        Self::open_within(OsStr::new("ffmpeg"), path, PATIENCE, words)
    }

    fn open_within(ffmpeg: &OsStr, path: &Path, patience: Duration, words: Option<u8>) -> Result<Self, VideoError> {
        if !path.is_file() {
            return Err(VideoError::Missing { path: path.to_owned() });
        }
        let failed = |source| VideoError::NoFfmpeg { path: path.to_owned(), source };
        // Messages go to a file: a pipe that nobody reads would fill up and stop the decoder.
        let messages = tempfile::tempfile().map_err(failed)?;
        let mut input = std::ffi::OsString::from("file:");
        input.push(path);
        let mut command = Command::new(ffmpeg);
        command
            .args(["-nostdin", "-v", "error", "-xerror", "-threads", "1", "-i"])
            .arg(input)
            .args([
                "-map",
                "0:v:0",
                "-vsync",
                "passthrough",
                "-f",
                "image2pipe",
                "-pix_fmt",
                if words.is_some() { "rgb48be" } else { "rgb24" },
                "-c:v",
                "ppm",
                "-",
            ])
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(messages.try_clone().map_err(failed)?);
        let mut program = Piped::start(command, patience).map_err(failed)?;
        let Some(frames) = program.child().stdout.take() else {
            return Err(failed(io::Error::other("its output is not connected")));
        };
        let frames = BufReader::with_capacity(1 << 18, frames);
        Ok(Self { path: path.to_owned(), program, frames, messages, words: words.map(|bits| (bits, 0)) })
    }

    /// The largest sample so far, where samples have 16 bits and the video was opened for that.
    #[must_use]
    pub fn largest(&self) -> Option<u16> {
        self.words.map(|(_, largest)| largest)
    }

    /// The next frame, or `None` after the last one.
    ///
    /// # Errors
    /// If the video is damaged or cut short, or has a sample of more bits than count.
    pub fn next_frame(&mut self) -> Result<Option<ImageRgb8>, VideoError> {
        let Self { program, frames, words, .. } = self;
        match program.waits(|_| read_ppm(frames, words.as_mut())) {
            Ok(Some(frame)) => match *words {
                Some((bits, sample)) if u32::from(sample) >> bits != 0 => {
                    Err(VideoError::MoreBits { path: self.path.clone(), sample, bits })
                }
                _ => Ok(Some(frame)),
            },
            Ok(None) => self.finish().map(|()| None),
            Err(source) => {
                // Where the decoder failed, its own words say more than the broken pipe.
                self.finish()?;
                Err(VideoError::Pipe { path: self.path.clone(), source })
            }
        }
    }

    fn finish(&mut self) -> Result<(), VideoError> {
        let status = self.program.wait().map_err(|source| VideoError::Pipe { path: self.path.clone(), source })?;
        if status.success() {
            return Ok(());
        }
        let message = messages_of(&mut self.messages, status);
        Err(VideoError::Decode { path: self.path.clone(), message: message.replace('\n', "; ") })
    }
}

/// What ffmpeg said, or how it ended where it said nothing.
fn messages_of(messages: &mut File, status: ExitStatus) -> String {
    let mut message = Vec::new();
    let read = messages.seek(SeekFrom::Start(0)).and_then(|_| messages.take(2000).read_to_end(&mut message));
    match (read, String::from_utf8_lossy(&message).trim()) {
        (Ok(_), text) if !text.is_empty() => text.to_owned(),
        _ => status.to_string(),
    }
}

/// One binary PPM image, or `None` at the end of the stream: of 8 bits per channel, or of 16, of which so many count, with the largest
/// sample so far.
fn read_ppm(stream: &mut impl BufRead, words: Option<&mut (u8, u16)>) -> io::Result<Option<ImageRgb8>> {
    if stream.fill_buf()?.is_empty() {
        return Ok(None);
    }
    let invalid = |what: &str| io::Error::new(io::ErrorKind::InvalidData, what.to_owned());
    let mut word = || {
        let mut text = String::new();
        loop {
            let mut byte = [0];
            stream.read_exact(&mut byte)?;
            match byte[0] {
                b' ' | b'\n' | b'\r' | b'\t' if text.is_empty() => {}
                b' ' | b'\n' | b'\r' | b'\t' => return Ok(text),
                _ if text.len() == 8 => return Err(invalid("no PPM header")),
                other => text.push(other.into()),
            }
        }
    };
    let header = [word()?, word()?, word()?, word()?];
    let white = if words.is_some() { "65535" } else { "255" };
    let ["P6", width, height, _] = header.each_ref().map(String::as_str) else {
        return Err(invalid("no PPM image"));
    };
    if header[3] != white {
        return Err(invalid("a PPM image of another depth"));
    }
    let (Ok(width @ 1..), Ok(height @ 1..)) = (width.parse::<u16>(), height.parse::<u16>()) else {
        return Err(invalid("a PPM image of an impossible size"));
    };
    let mut image = ImageRgb8::new(width.into(), height.into());
    match words {
        None => stream.read_exact(&mut image.data)?,
        Some((bits, largest)) => {
            let mut samples = vec![0; 2 * image.data.len()];
            stream.read_exact(&mut samples)?;
            let (levels, most) = depth::levels(&samples, (1 << *bits) - 1);
            image.data = levels;
            *largest = most.max(*largest);
        }
    }
    Ok(Some(image))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ppm_images_follow_each_other_and_cuts_are_errors() {
        let stream = b"P6\n2 1\n255\nabcdefP6 1 1 255\n\n\n\n";
        let mut rest = &stream[..];
        let first = read_ppm(&mut rest, None).unwrap().unwrap();
        assert_eq!((first.width, first.height, first.data.as_slice()), (2, 1, &b"abcdef"[..]));
        assert_eq!(read_ppm(&mut rest, None).unwrap().unwrap().data, b"\n\n\n");
        assert_eq!(read_ppm(&mut rest, None).unwrap(), None);
        for length in 1..17 {
            assert!(read_ppm(&mut &stream[..length], None).is_err(), "{length}");
        }
        for bad in ["P5\n2 1\n255\n", "P6\n0 1\n255\n", "P6\n2 1\n65535\n", "P6\n99999 99999\n255\n"] {
            assert!(read_ppm(&mut [bad.as_bytes(), &[0; 64]].concat().as_slice(), None).is_err(), "{bad:?}");
        }
    }

    #[test]
    fn without_ffmpeg_the_error_says_what_to_install() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let error = Video::open_within(OsStr::new("no-such-ffmpeg"), file.path(), PATIENCE, None).unwrap_err();
        assert!(
            matches!(error, VideoError::NoFfmpeg { .. }) && error.to_string().contains("install ffmpeg"),
            "{error}"
        );
        let error = Video::open(Path::new("no/such/video.mp4")).unwrap_err();
        assert!(matches!(error, VideoError::Missing { .. }), "{error}");
    }

    #[test]
    fn samples_of_any_depth_fill_eight_bits() {
        let folder = tempfile::tempdir().unwrap();
        // A ramp of all levels in 8, 10, 12 and 16 bits, which a lossless codec keeps.
        for pixels in ["gray", "gray10le", "gray12le", "gray16le", "yuv444p10le", "gbrp12le", "rgb48le"] {
            let path = folder.path().join(format!("{pixels}.mkv"));
            let made = Command::new("ffmpeg")
                .args(["-v", "error", "-f", "lavfi", "-i", "color=black:s=256x16:r=10,format=gray16le,geq=lum=X*257"])
                .args(["-frames:v", "2", "-pix_fmt", pixels, "-c:v", "ffv1", "-y"])
                .arg(&path)
                .status()
                .expect("ffmpeg is installed by scripts/setup.sh");
            assert!(made.success(), "{pixels}");
            let mut video = Video::open(&path).unwrap();
            for _ in 0..2 {
                let frame = video.next_frame().unwrap().unwrap();
                for x in 0..256 {
                    let level = i32::from(frame.pixel(x, 8)[0]);
                    assert!(level.abs_diff(x as i32) <= 3, "{pixels}, column {x}: {level}");
                }
            }
            assert_eq!(video.next_frame().unwrap(), None);
        }
    }

    #[test]
    fn of_samples_of_16_bits_those_count_that_are_said_to() {
        let folder = tempfile::tempdir().unwrap();
        for (pixels, bits) in [("gray16le", 10), ("gray16le", 12), ("rgb48le", 10), ("gray16le", 16)] {
            let path = folder.path().join(format!("{pixels}-{bits}.mkv"));
            // A ramp to the largest sample of so many bits.
            let white = (1_u32 << bits) - 1;
            let ramp = format!("color=black:s=256x16:r=10,format=gray16le,geq=lum=floor(X*{white}/255)");
            let made = Command::new("ffmpeg")
                .args(["-v", "error", "-f", "lavfi", "-i", &ramp, "-frames:v", "1", "-pix_fmt", pixels])
                .args(["-c:v", "ffv1", "-y"])
                .arg(&path)
                .status()
                .expect("ffmpeg is installed by scripts/setup.sh");
            assert!(made.success(), "{pixels}");
            let mut video = Video::open_as(&path, Some(bits)).unwrap();
            let frame = video.next_frame().unwrap().unwrap();
            assert!(u32::from(video.largest().unwrap()).abs_diff(white) <= 2, "{pixels}: {:?}", video.largest());
            for x in 0..256 {
                assert!(i32::from(frame.pixel(x, 8)[0]).abs_diff(x as i32) <= 2, "{pixels}, {bits} bits, column {x}");
            }
            assert_eq!(video.next_frame().unwrap(), None);
            if bits > 10 {
                let message = Video::open_as(&path, Some(10)).unwrap().next_frame().unwrap_err().to_string();
                assert!(message.contains("--bits") && message.contains(pixels), "{message}");
            }
        }
    }

    #[test]
    fn a_decoder_that_hangs_is_ended_and_one_that_talks_does_not_stand_still() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let (program, file) = (folder.path().join("ffmpeg"), folder.path().join("a.mp4"));
        std::fs::write(&file, b"x").unwrap();
        let decoder = |script: &str| {
            std::fs::write(&program, format!("#!/bin/sh\n{script}\n")).unwrap();
            std::fs::set_permissions(&program, std::fs::Permissions::from_mode(0o755)).unwrap();
            Video::open_within(program.as_os_str(), &file, Duration::from_millis(500), None).unwrap().next_frame()
        };
        let hung = decoder("sleep 600").unwrap_err().to_string();
        assert!(hung.contains("stood still") && hung.contains("a.mp4"), "{hung}");
        // More words than a pipe holds.
        let talks = decoder("seq 100000 >&2; exit 1").unwrap_err().to_string();
        assert!(talks.contains("1; 2; 3") && talks.len() < 4000, "{talks}");
    }

    #[test]
    fn a_file_that_is_no_video_is_an_error_in_ffmpegs_words() {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), b"this is no video").unwrap();
        let error = Video::open(file.path()).unwrap().next_frame().unwrap_err();
        assert!(matches!(&error, VideoError::Decode { message, .. } if message.contains("Invalid data")), "{error}");
    }
}
