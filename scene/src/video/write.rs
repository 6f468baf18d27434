//! MP4 files by way of ffmpeg: an existing, well-kept encoder, found on every system that handles video.

use std::{
    ffi::OsStr,
    fs::File,
    io::{self, Write},
    path::{Path, PathBuf},
    process::{Command, Stdio},
};

use erfgs_base::{FileError, atomic::Place, children::Piped};

use super::{PATIENCE, VideoError, messages_of, whole};

/// A video that is being written. It appears under its name when it is finished, and not before.
#[derive(Debug)]
pub struct VideoWriter {
    ffmpeg: Piped,
    /// What it says, in a file: a pipe that nobody reads would fill up and stop it.
    messages: File,
    path: PathBuf,
    /// Where it is until then; nothing once it is finished.
    place: Option<Place>,
    frame_bytes: usize,
}

impl VideoWriter {
    /// Starts a video of `width` x `height` pixels at `fps` frames a second. Odd sizes lose a row or column, which H.264
    /// in 4:2:0 does not have.
    ///
    /// # Errors
    /// If ffmpeg cannot be started, or the folder cannot be written.
    pub fn create(path: &Path, width: u32, height: u32, fps: f64) -> Result<Self, VideoError> {
        Self::create_with(OsStr::new("ffmpeg"), path, [width, height], fps)
    }

    fn create_with(ffmpeg: &OsStr, path: &Path, [width, height]: [u32; 2], fps: f64) -> Result<Self, VideoError> {
        let size = format!("{width}x{height}");
        let place = Place::begin(path).map_err(FileError::when("write", path))?;
        let failed = |source| VideoError::NoEncoder { source };
        let messages = tempfile::tempfile().map_err(failed)?;
        let mut command = Command::new(ffmpeg);
        command
            .args(["-nostdin", "-loglevel", "error", "-y", "-f", "rawvideo", "-pix_fmt", "rgb24"])
            .args(["-video_size", &size, "-framerate", &fps.to_string(), "-i", "pipe:0"])
            .args(["-vf", "crop=trunc(iw/2)*2:trunc(ih/2)*2", "-c:v", "libx264", "-crf", "16", "-pix_fmt", "yuv420p"])
            .args(["-movflags", "+faststart"])
            .arg(place.path())
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(messages.try_clone().map_err(failed)?);
        Ok(Self {
            ffmpeg: Piped::start(command, PATIENCE).map_err(failed)?,
            messages,
            path: path.to_owned(),
            place: Some(place),
            frame_bytes: width as usize * height as usize * 3,
        })
    }

    /// Adds a frame: RGB, 8 bits a channel, row-major.
    ///
    /// # Errors
    /// If the frame is not as long as the others, or ffmpeg cannot write.
    pub fn push(&mut self, rgb: &[u8]) -> Result<(), VideoError> {
        if rgb.len() != self.frame_bytes {
            return Err(VideoError::FrameSize { bytes: rgb.len(), wanted: self.frame_bytes });
        }
        let closed = || io::Error::from(io::ErrorKind::BrokenPipe);
        let written = self.ffmpeg.waits(|child| child.stdin.as_mut().ok_or_else(closed)?.write_all(rgb));
        written.or_else(|source| {
            // What ffmpeg says tells more than the broken pipe.
            self.end()?;
            Err(VideoError::Encoder { what: "give ffmpeg a frame", source })
        })
    }

    /// Ends the video.
    ///
    /// # Errors
    /// If ffmpeg cannot write.
    pub fn finish(mut self) -> Result<(), VideoError> {
        self.end()?;
        let io = FileError::when("write", &self.path);
        if let Some(place) = &self.place
            && let Some(lacking) = whole::lacking(place.path()).map_err(&io)?
        {
            return Err(VideoError::Cut { path: self.path.clone(), lacking });
        }
        let placed = self.place.take().map_or(Ok(()), Place::finish);
        Ok(placed.map_err(io)?)
    }

    fn end(&mut self) -> Result<(), VideoError> {
        drop(self.ffmpeg.child().stdin.take());
        let status = self.ffmpeg.wait().map_err(|source| VideoError::Encoder { what: "wait for ffmpeg", source })?;
        if status.success() {
            return Ok(());
        }
        let message = messages_of(&mut self.messages, status);
        let full =
            [("No space left on device", io::ErrorKind::StorageFull), ("File too large", io::ErrorKind::FileTooLarge)];
        if let Some((_, kind)) = full.into_iter().find(|(words, _)| message.contains(words)) {
            return Err(FileError::when("write", &self.path)(kind.into()).into());
        }
        // By the name that the user knows.
        let building = self.place.as_ref().map(|place| place.path().to_string_lossy().into_owned());
        let message =
            building.map_or(message.clone(), |building| message.replace(&building, &self.path.to_string_lossy()));
        Err(VideoError::Encode { path: self.path.clone(), status: status.to_string(), message })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_video_of_odd_size_is_written_and_a_wrong_frame_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("x.mp4");
        let mut video = VideoWriter::create(&path, 33, 17, 30.0).expect("ffmpeg");
        for level in 0..4 {
            video.push(&[level * 60; 33 * 17 * 3]).expect("a frame");
        }
        assert!(video.push(&[0; 5]).is_err());
        video.finish().expect("a video");
        assert!(std::fs::metadata(&path).expect("the file").len() > 500);
    }

    #[test]
    fn a_path_that_cannot_be_written_is_named() {
        let file = tempfile::NamedTempFile::new().expect("a file");
        let error = VideoWriter::create(&file.path().join("all.mp4"), 16, 16, 30.0).expect_err("no folder");
        assert!(error.to_string().contains("all.mp4"), "{error}");
    }

    #[test]
    fn a_video_appears_when_it_is_finished_and_leaves_nothing_otherwise() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("x.mp4");
        std::fs::write(&path, b"an earlier one").expect("written");
        let frame = vec![0; 16 * 16 * 3];
        let mut video = VideoWriter::create(&path, 16, 16, 30.0).expect("ffmpeg");
        video.push(&frame).expect("a frame");
        drop(video);
        assert_eq!(std::fs::read(&path).expect("kept"), b"an earlier one");
        assert_eq!(std::fs::read_dir(folder.path()).expect("the folder").count(), 1);

        // An encoder that ends early, as on a full disk.
        let mut video = VideoWriter::create(&path, 16, 16, 30.0).expect("ffmpeg");
        video.ffmpeg.child().kill().expect("ended");
        let error = (0..1000).find_map(|_| video.push(&frame).err());
        assert!(error.or_else(|| video.finish().err()).is_some_and(|error| error.to_string().contains("x.mp4")));
        assert_eq!(std::fs::read(&path).expect("kept"), b"an earlier one");
        assert_eq!(std::fs::read_dir(folder.path()).expect("the folder").count(), 1);
    }
    /// As ffmpeg 5.1 does on a full disk.
    #[cfg(unix)]
    #[test]
    fn a_cut_video_of_an_encoder_that_says_that_all_is_well_does_not_appear() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().expect("a folder");
        let (program, path) = (folder.path().join("encoder"), folder.path().join("x.mp4"));
        let script =
            "#!/bin/sh\ncat > /dev/null\nfor last; do :; done\nprintf '\\0\\0\\1\\0ftyp, and no more' > \"$last\"\n";
        std::fs::write(&program, script).expect("written");
        std::fs::set_permissions(&program, PermissionsExt::from_mode(0o755)).expect("a program");
        let mut video = VideoWriter::create_with(program.as_os_str(), &path, [16, 16], 30.0).expect("started");
        video.push(&[0; 16 * 16 * 3]).expect("taken");
        let error = video.finish().expect_err("cut").to_string();
        assert!(error.contains("x.mp4") && error.contains("cut off") && error.contains("free some space"), "{error}");
        assert!(!path.exists());
        assert_eq!(std::fs::read_dir(folder.path()).expect("the folder").count(), 1);
    }
}
