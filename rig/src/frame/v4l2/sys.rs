//! V4L2 system calls: the only unsafe code of this driver. The structures and request numbers are those of the `v4l`
//! crate; its own wrappers are not used, since they panic on names and colour spaces that they do not know.
#![expect(
    unsafe_code,
    reason = "system calls take pointers to structures, and frames lie in memory that the kernel maps"
)]

use std::{
    fs::{File, OpenOptions},
    io::{self, ErrorKind},
    mem,
    os::{fd::AsRawFd, unix::fs::OpenOptionsExt},
    path::Path,
    ptr::NonNull,
    sync::Arc,
};

use v4l::{
    v4l_sys::{
        v4l2_buffer, v4l2_capability, v4l2_control, v4l2_fmtdesc, v4l2_format, v4l2_queryctrl, v4l2_requestbuffers,
        v4l2_streamparm,
    },
    v4l2::{self, vidioc},
};

/// `V4L2_BUF_TYPE_VIDEO_CAPTURE`.
const VIDEO_CAPTURE: u32 = 1;
/// `V4L2_MEMORY_MMAP`.
const MEMORY_MMAP: u32 = 1;
/// `V4L2_FIELD_NONE`: progressive.
const FIELD_NONE: u32 = 1;

/// What a node says of itself (`VIDIOC_QUERYCAP`).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Capabilities {
    /// The kernel driver.
    pub driver: String,
    /// The camera's name.
    pub card: String,
    /// Where it is plugged in.
    pub bus: String,
    /// The kernel's version.
    pub version: u32,
    /// What this node (not the whole device) can do.
    pub node: u32,
}

impl Capabilities {
    /// Whether frames can be had from this node by streaming. Metadata nodes of the same camera cannot.
    pub fn captures(&self) -> bool {
        const CAPTURE: u32 = 0x1;
        const STREAMING: u32 = 0x0400_0000;
        self.node & CAPTURE != 0 && self.node & STREAMING != 0
    }
}

/// A format as the driver accepted it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StreamFormat {
    pub fourcc: u32,
    pub width: u32,
    pub height: u32,
    /// Bytes from one row to the next; 0 for compressed formats.
    pub stride: u32,
}

/// The range of a control.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ControlRange {
    pub minimum: i32,
    pub maximum: i32,
    pub step: i32,
    pub disabled: bool,
}

/// An open video node.
#[derive(Debug)]
pub struct Node(File);

fn text(bytes: &[u8]) -> String {
    let end = bytes.iter().position(|&byte| byte == 0).unwrap_or(bytes.len());
    String::from_utf8_lossy(&bytes[..end]).into_owned()
}

impl Node {
    pub fn open(path: &Path) -> io::Result<Self> {
        OpenOptions::new().read(true).write(true).custom_flags(libc::O_NONBLOCK).open(path).map(Self)
    }

    /// # Safety
    /// `T` must be the structure that `request` belongs to, with its pointers valid.
    unsafe fn call<T>(&self, request: vidioc::_IOC_TYPE, argument: &mut T) -> io::Result<()> {
        loop {
            // SAFETY: the descriptor is open as long as `self` is; `argument` is a valid structure of the request's
            // type, as the caller promises, and the kernel writes no further than that.
            match unsafe { v4l2::ioctl(self.0.as_raw_fd(), request, (&raw mut *argument).cast()) } {
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                result => return result,
            }
        }
    }

    pub fn capabilities(&self) -> io::Result<Capabilities> {
        // SAFETY: all-zero is a value of this structure of plain numbers; it belongs to the request.
        let answer = unsafe {
            let mut answer: v4l2_capability = mem::zeroed();
            self.call(vidioc::VIDIOC_QUERYCAP, &mut answer)?;
            answer
        };
        const DEVICE_CAPS: u32 = 0x8000_0000;
        // Kernels before 3.4 know no capabilities of single nodes.
        let node = if answer.capabilities & DEVICE_CAPS != 0 { answer.device_caps } else { answer.capabilities };
        Ok(Capabilities {
            driver: text(&answer.driver),
            card: text(&answer.card),
            bus: text(&answer.bus_info),
            version: answer.version,
            node,
        })
    }

    /// The formats that the node offers, as four-character codes.
    pub fn formats(&self) -> Vec<u32> {
        let describe = |index| {
            // SAFETY: as in `capabilities`.
            unsafe {
                let mut format = v4l2_fmtdesc { index, type_: VIDEO_CAPTURE, ..mem::zeroed() };
                self.call(vidioc::VIDIOC_ENUM_FMT, &mut format).map(|()| format.pixelformat)
            }
        };
        (0..256).map_while(|index| describe(index).ok()).collect()
    }

    pub fn set_format(&self, fourcc: u32, width: u32, height: u32) -> io::Result<StreamFormat> {
        // SAFETY: as in `capabilities`; for this buffer type the union's member is `pix`, before and after the call.
        unsafe {
            let mut format = v4l2_format { type_: VIDEO_CAPTURE, ..mem::zeroed() };
            format.fmt.pix.pixelformat = fourcc;
            format.fmt.pix.width = width;
            format.fmt.pix.height = height;
            format.fmt.pix.field = FIELD_NONE;
            self.call(vidioc::VIDIOC_S_FMT, &mut format)?;
            let pix = format.fmt.pix;
            Ok(StreamFormat { fourcc: pix.pixelformat, width: pix.width, height: pix.height, stride: pix.bytesperline })
        }
    }

    /// Asks for so many frames a second; gives the interval that the driver chose, in seconds as a fraction.
    pub fn set_interval(&self, numerator: u32, denominator: u32) -> io::Result<(u32, u32)> {
        // SAFETY: as in `capabilities`; for this buffer type the union's member is `capture`.
        unsafe {
            let mut parameters = v4l2_streamparm { type_: VIDEO_CAPTURE, ..mem::zeroed() };
            parameters.parm.capture.timeperframe.numerator = numerator;
            parameters.parm.capture.timeperframe.denominator = denominator;
            self.call(vidioc::VIDIOC_S_PARM, &mut parameters)?;
            let interval = parameters.parm.capture.timeperframe;
            Ok((interval.numerator, interval.denominator))
        }
    }

    /// The range of a control; an error if the camera has none such.
    pub fn control_range(&self, id: u32) -> io::Result<ControlRange> {
        const DISABLED: u32 = 1;
        // SAFETY: as in `capabilities`.
        unsafe {
            let mut query = v4l2_queryctrl { id, ..mem::zeroed() };
            self.call(vidioc::VIDIOC_QUERYCTRL, &mut query)?;
            Ok(ControlRange {
                minimum: query.minimum,
                maximum: query.maximum,
                step: query.step,
                disabled: query.flags & DISABLED != 0,
            })
        }
    }

    pub fn control(&self, id: u32) -> io::Result<i32> {
        let mut control = v4l2_control { id, value: 0 };
        // SAFETY: the structure belongs to the request.
        unsafe { self.call(vidioc::VIDIOC_G_CTRL, &mut control) }.map(|()| control.value)
    }

    pub fn set_control(&self, id: u32, value: i32) -> io::Result<()> {
        let mut control = v4l2_control { id, value };
        // SAFETY: the structure belongs to the request.
        unsafe { self.call(vidioc::VIDIOC_S_CTRL, &mut control) }
    }

    /// Waits until a frame can be taken, or the node fails; `false` if neither happens in time.
    fn wait(&self, milliseconds: i32) -> io::Result<bool> {
        let mut poll = libc::pollfd { fd: self.0.as_raw_fd(), events: libc::POLLIN, revents: 0 };
        // SAFETY: one valid structure, and the count says so.
        match unsafe { libc::poll(&raw mut poll, 1, milliseconds) } {
            -1 => match io::Error::last_os_error() {
                error if error.kind() == ErrorKind::Interrupted => Ok(false),
                error => Err(error),
            },
            ready => Ok(ready != 0),
        }
    }
}

/// A frame in one of the stream's buffers.
#[derive(Clone, Copy, Debug)]
pub struct Filled {
    index: u32,
    pub used: u32,
    pub flags: u32,
    pub sequence: u32,
    pub timestamp_ns: i64,
}

/// Memory that the kernel writes frames into.
#[derive(Debug)]
struct Mapping {
    address: NonNull<u8>,
    length: usize,
}

// SAFETY: the mapping belongs to its `Mapping` alone, and is not tied to a thread.
unsafe impl Send for Mapping {}

impl Drop for Mapping {
    fn drop(&mut self) {
        // SAFETY: address and length are those that `mmap` gave, and nothing borrows from a mapping being dropped.
        unsafe { libc::munmap(self.address.as_ptr().cast(), self.length) };
    }
}

/// A node that streams. Dropping it stops the stream.
#[derive(Debug)]
pub struct NodeStream {
    node: Arc<Node>,
    buffers: Vec<Mapping>,
}

impl NodeStream {
    /// Starts streaming into so many buffers (the driver may give more or fewer).
    pub fn start(node: Arc<Node>, buffers: u32) -> io::Result<Self> {
        // SAFETY: as in `Node::capabilities`.
        let count = unsafe {
            let mut request =
                v4l2_requestbuffers { count: buffers, type_: VIDEO_CAPTURE, memory: MEMORY_MMAP, ..mem::zeroed() };
            node.call(vidioc::VIDIOC_REQBUFS, &mut request)?;
            request.count
        };
        let mut stream = Self { node, buffers: Vec::new() };
        for index in 0..count {
            let mapping = stream.map(index)?;
            stream.buffers.push(mapping);
            stream.queue(index)?;
        }
        let mut kind = VIDEO_CAPTURE as libc::c_int;
        // SAFETY: the request takes a pointer to an integer.
        unsafe { stream.node.call(vidioc::VIDIOC_STREAMON, &mut kind)? };
        Ok(stream)
    }

    pub fn buffers(&self) -> usize {
        self.buffers.len()
    }

    fn describe(index: u32) -> v4l2_buffer {
        // SAFETY: all-zero is a value of this structure of numbers, and of pointers that are not used with MMAP.
        unsafe { v4l2_buffer { index, type_: VIDEO_CAPTURE, memory: MEMORY_MMAP, ..mem::zeroed() } }
    }

    fn map(&self, index: u32) -> io::Result<Mapping> {
        let mut buffer = Self::describe(index);
        // SAFETY: the structure belongs to the request. `mmap` with a null address touches no mapping of ours; the
        // offset is the one that the driver gave for this buffer (the union's member with MMAP).
        let address = unsafe {
            self.node.call(vidioc::VIDIOC_QUERYBUF, &mut buffer)?;
            let offset = libc::off_t::from(buffer.m.offset);
            let access = libc::PROT_READ | libc::PROT_WRITE;
            let length = buffer.length as usize;
            libc::mmap(std::ptr::null_mut(), length, access, libc::MAP_SHARED, self.node.0.as_raw_fd(), offset)
        };
        if address == libc::MAP_FAILED {
            return Err(io::Error::last_os_error());
        }
        let address = NonNull::new(address.cast()).ok_or_else(|| io::Error::other("mapped at address 0"))?;
        Ok(Mapping { address, length: buffer.length as usize })
    }

    fn queue(&self, index: u32) -> io::Result<()> {
        // SAFETY: the structure belongs to the request.
        unsafe { self.node.call(vidioc::VIDIOC_QBUF, &mut Self::describe(index)) }
    }

    /// Takes the next frame; `None` if none comes in time.
    pub fn next(&mut self, milliseconds: i32) -> io::Result<Option<Filled>> {
        if !self.node.wait(milliseconds)? {
            return Ok(None);
        }
        let mut buffer = Self::describe(0);
        // SAFETY: the structure belongs to the request.
        match unsafe { self.node.call(vidioc::VIDIOC_DQBUF, &mut buffer) } {
            Ok(()) => {}
            Err(error) if error.kind() == ErrorKind::WouldBlock => return Ok(None),
            Err(error) => return Err(error),
        }
        Ok(Some(Filled {
            index: buffer.index,
            used: buffer.bytesused,
            flags: buffer.flags,
            sequence: buffer.sequence,
            timestamp_ns: buffer.timestamp.tv_sec * 1_000_000_000 + buffer.timestamp.tv_usec * 1000,
        }))
    }

    /// The bytes of a frame that was taken, and not given back.
    pub fn bytes(&self, frame: &Filled) -> &[u8] {
        let Some(buffer) = self.buffers.get(frame.index as usize) else { return &[] };
        let used = (frame.used as usize).min(buffer.length);
        // SAFETY: the mapping is `length` bytes long and lives as long as `self`. The kernel does not write to a
        // buffer that is not queued, and `give_back`, which queues it, needs `self` to itself.
        unsafe { std::slice::from_raw_parts(buffer.address.as_ptr(), used) }
    }

    /// Gives the buffer back to the kernel.
    pub fn give_back(&mut self, frame: Filled) -> io::Result<()> {
        self.queue(frame.index)
    }
}

impl Drop for NodeStream {
    fn drop(&mut self) {
        let mut kind = VIDEO_CAPTURE as libc::c_int;
        // SAFETY: the request takes a pointer to an integer. An unplugged camera answers ENODEV: there is nothing left
        // to stop then.
        if let Err(error) = unsafe { self.node.call(vidioc::VIDIOC_STREAMOFF, &mut kind) } {
            tracing::debug!("while a stream is stopped: {error}");
        }
    }
}
