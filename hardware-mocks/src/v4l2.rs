//! V4L2 cameras without a kernel: `v4l2/cameras.c`, built on the spot with the C compiler and preloaded into a process.

use std::{
    fs, io,
    path::{Path, PathBuf},
    process::Command,
};

/// A folder of emulated cameras, and the library that makes them open as such.
pub struct Cameras {
    nodes: PathBuf,
    class: PathBuf,
    library: PathBuf,
}

impl Cameras {
    /// Builds the library in `folder`, which will hold the nodes in `dev` and their description in `class`.
    ///
    /// # Errors
    /// If the C compiler is missing or fails.
    pub fn build(folder: &Path) -> io::Result<Self> {
        let cameras = Self::at(folder);
        fs::create_dir_all(&cameras.nodes)?;
        fs::create_dir_all(&cameras.class)?;
        let output = Command::new("cc")
            .args([
                "-std=gnu11",
                "-O2",
                "-Wall",
                "-Wextra",
                "-Werror",
                "-Wno-maybe-uninitialized",
                "-shared",
                "-fPIC",
                "-o",
            ])
            .arg(&cameras.library)
            .arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("v4l2/cameras.c"))
            .arg("-ldl")
            .output()
            .map_err(|error| {
                io::Error::new(error.kind(), format!("cannot run cc: {error}; scripts/setup.sh installs it"))
            })?;
        if output.status.success() {
            return Ok(cameras);
        }
        Err(io::Error::other(format!("cc failed:\n{}", String::from_utf8_lossy(&output.stderr))))
    }

    /// Cameras that [`Cameras::build`] made in `folder`.
    #[must_use]
    pub fn at(folder: &Path) -> Self {
        Self { nodes: folder.join("dev"), class: folder.join("class"), library: folder.join("libcameras.so") }
    }

    /// The folder of nodes: `/dev` of these cameras.
    #[must_use]
    pub fn nodes(&self) -> &Path {
        &self.nodes
    }

    /// `/sys/class/video4linux` of these cameras.
    #[must_use]
    pub fn class(&self) -> &Path {
        &self.class
    }

    /// Makes a process see the cameras.
    pub fn preload(&self, command: &mut Command) {
        command.env("LD_PRELOAD", &self.library).env("ERFGS_CAMERAS", &self.nodes);
    }

    /// Plugs a camera in as `videoN`; `description` as the library reads it. With a serial number it is a USB camera.
    ///
    /// # Errors
    /// If the files cannot be written.
    pub fn plug(&self, number: u32, serial: &str, description: &str) -> io::Result<()> {
        let name = format!("video{number}");
        let device = self.class.join(format!("usb-{number}"));
        fs::create_dir_all(device.join("interface"))?;
        fs::write(device.join("serial"), format!("{serial}\n"))?;
        fs::create_dir_all(self.class.join(&name))?;
        let link = self.class.join(&name).join("device");
        if fs::symlink_metadata(&link).is_err() {
            std::os::unix::fs::symlink(device.join("interface"), link)?;
        }
        fs::write(self.nodes.join(name), description)
    }
}
