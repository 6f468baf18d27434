//! Adapter choice, device and buffers.

use std::sync::{Arc, Mutex, PoisonError};

use bytemuck::Pod;
use erfgs_base::memory::{self, Shortage};
use wgpu::util::DeviceExt;

use super::{
    memory::{self as device_memory, Watched, stored},
    reuse::Reused,
    submissions::{Held, Submission},
    timing::{self, Times},
    traffic::{Counters, Traffic},
};

/// What can go wrong on the device.
#[derive(Debug, thiserror::Error)]
pub enum GpuError {
    /// No adapter was found.
    #[error(
        "no Vulkan, Metal or DirectX 12 adapter was found{}; install a driver (on Debian 12: scripts/setup.sh brings Mesa's lavapipe 25 from backports) and see `erfgs doctor`",
        filter.as_ref().map(|f| format!(" whose name contains '{f}'")).unwrap_or_default()
    )]
    NoAdapter {
        /// The name that was asked for.
        filter: Option<String>,
    },
    /// The adapter refused a device.
    #[error("adapter '{adapter}' refused a device: {message}")]
    Device {
        /// Name of the adapter.
        adapter: String,
        /// What it said.
        message: String,
    },
    /// The driver computes wrong results.
    #[error(
        "adapter '{adapter}' ({driver}) computes wrong results: {finding}; use another driver (Mesa 25 or later) or set VK_DRIVER_FILES to one"
    )]
    BrokenDriver {
        /// Name of the adapter.
        adapter: String,
        /// Its driver.
        driver: String,
        /// What the canary found.
        finding: String,
    },
    /// A buffer is larger than the adapter can bind.
    #[error(
        "'{label}' needs {needed} bytes, but adapter '{adapter}' binds at most {limit} at a time; use fewer Gaussians, a lower SH degree or a smaller image"
    )]
    TooLarge {
        /// What the buffer holds.
        label: String,
        /// Name of the adapter.
        adapter: String,
        /// Bytes needed.
        needed: u64,
        /// Bytes that can be bound.
        limit: u64,
    },
    /// A buffer is larger than the memory that is free, which the adapter shares with the processor.
    #[error(
        "'{label}' does not fit into the memory of adapter '{adapter}': {shortage}; use fewer Gaussians, a smaller field or smaller images, or another adapter"
    )]
    NoMemory {
        /// What the buffer holds.
        label: String,
        /// Name of the adapter.
        adapter: String,
        /// What is needed and what there is.
        shortage: Shortage,
    },
    /// The device has no memory left.
    #[error(
        "adapter '{adapter}' ran out of memory while {doing}: {message}; use fewer Gaussians, a smaller field or smaller images, or another adapter"
    )]
    OutOfMemory {
        /// Name of the adapter.
        adapter: String,
        /// What was being done.
        doing: String,
        /// What the device said.
        message: String,
    },
    /// The device reported an error after the fact.
    #[error("the device failed while {doing}: {message}")]
    Failed {
        /// What was being done.
        doing: String,
        /// What the device said.
        message: String,
    },
}

/// For buffers of this size it is asked what memory is free.
const WORTH_ASKING: u64 = 64 << 20;

/// Which form of the kernels runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape {
    /// Workgroups of 256 threads, shared memory, everything stays on the device.
    Gpu,
    /// Several pixels a thread, no barriers, matrix products and sorting on the host.
    Cpu,
}

/// Which adapter to open.
#[derive(Clone, Debug, Default)]
pub struct AdapterChoice {
    /// Take the first adapter whose name contains this (ignoring case).
    pub name: Option<String>,
    /// Use this kernel shape whatever the adapter's type.
    pub shape: Option<Shape>,
}

/// An open device.
#[derive(Debug)]
pub struct Gpu {
    /// The wgpu device.
    pub device: wgpu::Device,
    /// Where work for it is submitted.
    pub queue: wgpu::Queue,
    /// What the adapter says of itself.
    pub info: wgpu::AdapterInfo,
    /// The limits of the device.
    pub limits: wgpu::Limits,
    /// Which form of the kernels runs here.
    pub shape: Shape,
    /// Whether storage buffers can be mapped in place.
    pub mappable: bool,
    /// So many threads are always within one subgroup; 0 without subgroup operations.
    pub subgroup: u32,
    /// See [`Gpu::memory`].
    memory: Option<u64>,
    pub(super) counters: Counters,
    pub(super) times: Times,
    pub(super) held: Held,
    pub(super) reused: Reused,
    pub(super) watched: Watched,
    failure: Arc<Mutex<Option<Failure>>>,
}

/// What the device said after the fact.
#[derive(Debug)]
struct Failure {
    out_of_memory: bool,
    message: String,
}

/// The adapters of this machine that kernels could run on, the preferred one first.
pub fn adapters() -> Vec<wgpu::AdapterInfo> {
    let mut found: Vec<_> = enumerate().iter().map(wgpu::Adapter::get_info).collect();
    found.sort_by_key(rank);
    found
}

/// Held while a device is opened: Vulkan's loader looks a device up among all of the process, and one that another thread is
/// just making has no table of functions yet (Debian's loader 1.3.239 then reads address 0x1cdc0de, the mark of such a device).
static OPENING: Mutex<()> = Mutex::new(());

/// Objects have names in a driver's messages where WGPU_DEBUG=1 asks for them; naming an object looks its device up as above.
/// Arguments of indirect dispatches are not checked by a dispatch before each, which takes a graphics processor as long as most of ours:
/// they are workgroups of a [`Plan`](crate::sort::Plan), at most 65,535 a dimension whatever is counted. WGPU_VALIDATION_INDIRECT_CALL=1
/// has them checked.
fn enumerate() -> Vec<wgpu::Adapter> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
        flags: wgpu::InstanceFlags::empty().with_env(),
        ..wgpu::InstanceDescriptor::new_without_display_handle_from_env()
    });
    pollster::block_on(instance.enumerate_adapters(wgpu::Backends::PRIMARY))
}

fn rank(info: &wgpu::AdapterInfo) -> u32 {
    match info.device_type {
        wgpu::DeviceType::DiscreteGpu => 0,
        wgpu::DeviceType::IntegratedGpu => 1,
        wgpu::DeviceType::VirtualGpu | wgpu::DeviceType::Other => 2,
        wgpu::DeviceType::Cpu => 3,
    }
}

impl Gpu {
    /// Opens the adapter of `choice`; without a name a discrete or integrated GPU is preferred to a software adapter.
    ///
    /// # Errors
    /// [`GpuError::NoAdapter`] and [`GpuError::Device`].
    pub fn open(choice: &AdapterChoice) -> Result<Self, GpuError> {
        let _opening = OPENING.lock().unwrap_or_else(PoisonError::into_inner);
        let mut adapters = enumerate();
        if let Some(filter) = &choice.name {
            let filter = filter.to_lowercase();
            adapters.retain(|adapter| adapter.get_info().name.to_lowercase().contains(&filter));
        }
        let adapter = adapters
            .into_iter()
            .min_by_key(|adapter| rank(&adapter.get_info()))
            .ok_or_else(|| GpuError::NoAdapter { filter: choice.name.clone() })?;
        let info = adapter.get_info();
        let features = adapter.features()
            & (wgpu::Features::MAPPABLE_PRIMARY_BUFFERS | wgpu::Features::SUBGROUP | timing::FEATURES);
        let shape = choice.shape.unwrap_or(match info.device_type {
            wgpu::DeviceType::Cpu => Shape::Cpu,
            _ => Shape::Gpu,
        });
        let limits = adapter.limits();
        let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("erfgs"),
            required_features: features,
            required_limits: limits.clone(),
            ..Default::default()
        }))
        .map_err(|error| GpuError::Device { adapter: info.name.clone(), message: error.to_string() })?;
        let failure = Arc::new(Mutex::new(None));
        let record = Arc::clone(&failure);
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            if let Ok(mut slot) = record.lock() {
                let out_of_memory = matches!(error, wgpu::Error::OutOfMemory { .. });
                slot.get_or_insert_with(|| Failure { out_of_memory, message: error.to_string() });
            }
        }));
        let mappable = shape == Shape::Cpu && features.contains(wgpu::Features::MAPPABLE_PRIMARY_BUFFERS);
        let subgroup = if features.contains(wgpu::Features::SUBGROUP) { info.subgroup_min_size } else { 0 };
        let memory = device_memory::own(&adapter);
        Ok(Self {
            device,
            queue,
            info,
            limits,
            shape,
            mappable,
            subgroup,
            memory,
            counters: Counters::default(),
            times: Times::default(),
            held: Held::default(),
            reused: Reused::default(),
            watched: Watched::default(),
            failure,
        })
    }

    /// A zeroed storage buffer of `bytes` bytes (at least 16, rounded up to 16).
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] where the adapter cannot bind it, [`GpuError::NoMemory`] where it has not so much memory.
    pub fn storage(&self, label: &str, bytes: u64) -> Result<wgpu::Buffer, GpuError> {
        let size = stored(bytes);
        let limit = self.limits.max_storage_buffer_binding_size.min(self.limits.max_buffer_size);
        if size > limit {
            return Err(GpuError::TooLarge {
                label: label.into(),
                adapter: self.info.name.clone(),
                needed: size,
                limit,
            });
        }
        self.reused.makes(size);
        if self.shares_memory() && size >= WORTH_ASKING {
            memory::afford(size).map_err(|shortage| GpuError::NoMemory {
                label: label.into(),
                adapter: self.info.name.clone(),
                shortage,
            })?;
        }
        let buffer = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size,
            usage: self.storage_usage(),
            mapped_at_creation: false,
        });
        self.look_at_memory();
        Ok(buffer)
    }

    /// A storage buffer that holds `data`.
    ///
    /// # Errors
    /// As [`Gpu::storage`].
    pub fn storage_from<T: Pod>(&self, label: &str, data: &[T]) -> Result<wgpu::Buffer, GpuError> {
        let buffer = self.storage(label, size_of_val(data) as u64)?;
        // No recording that is held back knows the buffer.
        self.write(&buffer, 0, bytemuck::cast_slice(data));
        Ok(buffer)
    }

    /// A uniform buffer that holds `value` for good: the same where it was asked for not long ago.
    pub fn uniform<T: Pod>(&self, label: &str, value: &T) -> wgpu::Buffer {
        let contents = bytemuck::bytes_of(value);
        self.reused.uniform(label, contents, || {
            self.counters.written(contents.len() as u64);
            let usage = wgpu::BufferUsages::UNIFORM;
            self.device.create_buffer_init(&wgpu::util::BufferInitDescriptor { label: Some(label), contents, usage })
        })
    }

    /// Writes `data` into `buffer` from byte `offset` on, after everything that was recorded and handed over or held back. The latter is
    /// handed over for it: the device writes before the submission that follows.
    pub fn upload<T: Pod>(&self, buffer: &wgpu::Buffer, offset: u64, data: &[T]) {
        if !data.is_empty() {
            self.flush();
        }
        self.write(buffer, offset, bytemuck::cast_slice(data));
    }

    fn write(&self, buffer: &wgpu::Buffer, offset: u64, bytes: &[u8]) {
        if !bytes.is_empty() {
            self.counters.written(bytes.len() as u64);
            self.queue.write_buffer(buffer, offset, bytes);
            self.look_at_memory();
        }
    }

    /// Waits for the device, then lends the first `counts[i]` elements of each buffer to `read`. On a mappable adapter
    /// nothing is copied.
    ///
    /// # Errors
    /// [`GpuError::Failed`].
    pub fn read<T: Pod, R>(
        &self,
        buffers: &[(&wgpu::Buffer, usize)],
        read: impl FnOnce(&[&[T]]) -> R,
    ) -> Result<R, GpuError> {
        let bytes_of = |count: usize| ((count * size_of::<T>()) as u64).next_multiple_of(8).max(8);
        let mapped: Vec<wgpu::Buffer> = if self.mappable {
            buffers.iter().map(|(buffer, _)| (*buffer).clone()).collect()
        } else {
            let mut encoder = self.device.create_command_encoder(&Default::default());
            let copies = buffers
                .iter()
                .map(|(buffer, count)| {
                    let size = bytes_of(*count);
                    let copy = self.device.create_buffer(&wgpu::BufferDescriptor {
                        label: Some("read back"),
                        size,
                        usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
                        mapped_at_creation: false,
                    });
                    encoder.copy_buffer_to_buffer(buffer, 0, &copy, 0, size);
                    copy
                })
                .collect();
            self.look_at_memory();
            self.hand_over(encoder.finish());
            copies
        };
        self.flush();
        for (buffer, (_, count)) in mapped.iter().zip(buffers) {
            self.counters.mapped(bytes_of(*count));
            buffer.slice(..bytes_of(*count)).map_async(wgpu::MapMode::Read, |_| {});
        }
        self.wait("reading results back")?;
        let failed = |error: wgpu::MapRangeError| GpuError::Failed {
            doing: "mapping a buffer".into(),
            message: error.to_string(),
        };
        let result = {
            let views = mapped
                .iter()
                .zip(buffers)
                .map(|(buffer, (_, count))| buffer.slice(..bytes_of(*count)).get_mapped_range())
                .collect::<Result<Vec<_>, _>>()
                .map_err(failed)?;
            let slices: Vec<&[T]> = views
                .iter()
                .zip(buffers)
                .map(|(view, (_, count))| bytemuck::cast_slice(&view[..count * size_of::<T>()]))
                .collect();
            read(&slices)
        };
        for buffer in &mapped {
            buffer.unmap();
        }
        Ok(result)
    }

    /// A copy of the first `count` elements of `buffer`.
    ///
    /// # Errors
    /// [`GpuError::Failed`].
    pub fn download<T: Pod>(&self, buffer: &wgpu::Buffer, count: usize) -> Result<Vec<T>, GpuError> {
        self.read(&[(buffer, count)], |slices| slices[0].to_vec())
    }

    /// Lets go of the bind groups of what was dispatched so far, which keep their buffers in memory: for whoever is about to replace most of
    /// those.
    pub fn forget_groups(&self) {
        self.reused.forget();
    }

    /// Bytes of the memory that the device has of its own; `None` where it shares the processor's, or nobody says.
    pub fn memory(&self) -> Option<u64> {
        self.memory
    }

    /// Whether the device's memory is the processor's.
    pub fn shares_memory(&self) -> bool {
        matches!(self.info.device_type, wgpu::DeviceType::Cpu | wgpu::DeviceType::IntegratedGpu)
    }

    /// What has passed between the host and the device so far.
    pub fn traffic(&self) -> Traffic {
        self.counters.so_far()
    }

    /// Maps a buffer that was made for it, once what was submitted until then is done, and lends its bytes to `read`.
    ///
    /// # Errors
    /// [`GpuError::Failed`].
    pub fn read_mapped<R>(
        &self,
        buffer: &wgpu::Buffer,
        submission: &Submission,
        doing: &str,
        read: impl FnOnce(&[u8]) -> R,
    ) -> Result<R, GpuError> {
        let failed = |message: String| GpuError::Failed { doing: doing.into(), message };
        let slice = buffer.slice(..);
        self.counters.mapped(buffer.size());
        let submission_index = self.handed_over(submission);
        slice.map_async(wgpu::MapMode::Read, |_| {});
        self.device
            .poll(wgpu::PollType::Wait { submission_index, timeout: None })
            .map_err(|error| failed(error.to_string()))?;
        let result = read(&slice.get_mapped_range().map_err(|error| failed(error.to_string()))?);
        buffer.unmap();
        Ok(result)
    }

    /// Waits until everything submitted, what was held back included, is done, and reports what failed meanwhile.
    ///
    /// # Errors
    /// [`GpuError::Failed`].
    pub fn wait(&self, doing: &str) -> Result<(), GpuError> {
        self.flush();
        let polled = self.device.poll(wgpu::PollType::wait_indefinitely());
        let failure = self.failure.lock().ok().and_then(|mut slot| slot.take());
        match (polled, failure) {
            (_, Some(Failure { out_of_memory: true, message })) => {
                Err(GpuError::OutOfMemory { adapter: self.info.name.clone(), doing: doing.into(), message })
            }
            (_, Some(Failure { message, .. })) => Err(GpuError::Failed { doing: doing.into(), message }),
            (Err(error), None) => Err(GpuError::Failed { doing: doing.into(), message: error.to_string() }),
            (Ok(_), None) => Ok(()),
        }
    }

    fn storage_usage(&self) -> wgpu::BufferUsages {
        use wgpu::BufferUsages as Usage;
        let base = Usage::STORAGE | Usage::COPY_SRC | Usage::COPY_DST | Usage::INDIRECT;
        if self.mappable { base | Usage::MAP_READ } else { base }
    }
}
