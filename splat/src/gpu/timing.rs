//! How long each kernel takes on the device, told by its own clock.
//!
//! A timestamp is written before and after each dispatch of a submission, and the submission is waited for: the sums tell where the
//! device's time goes, but what is timed runs slower than it does otherwise.

use std::{
    collections::HashMap,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
};

use super::{Gpu, GpuError, Submission};

/// What the device has to do for it.
pub(super) const FEATURES: wgpu::Features = wgpu::Features::TIMESTAMP_QUERY
    .union(wgpu::Features::TIMESTAMP_QUERY_INSIDE_ENCODERS)
    .union(wgpu::Features::TIMESTAMP_QUERY_INSIDE_PASSES);

/// Timestamps of one set.
const SET: u32 = wgpu::QUERY_SET_MAX_QUERIES;

/// The time of one kernel.
#[derive(Clone, Debug, PartialEq)]
pub struct KernelTime {
    /// Its name.
    pub kernel: Arc<str>,
    /// How often it was dispatched.
    pub dispatches: u64,
    /// Its time on the device, seconds.
    pub seconds: f64,
}

/// Dispatches and ticks of the device's clock, by kernel.
type Sums = HashMap<Arc<str>, (u64, u64)>;

/// Sums since timing began; nothing while kernels are not timed.
#[derive(Debug, Default)]
pub(super) struct Times(Mutex<Option<Sums>>);

/// The timestamps of a submission that is recorded: two of each dispatch.
#[derive(Debug)]
pub(super) struct Stamps {
    sets: Vec<wgpu::QuerySet>,
    kernels: Vec<Arc<str>>,
}

impl Gpu {
    /// From now on each dispatch is timed, and each submission waited for.
    ///
    /// # Errors
    /// [`GpuError::Device`] where the adapter has no timestamps.
    pub fn time_kernels(&self) -> Result<(), GpuError> {
        if !self.device.features().contains(FEATURES) {
            return Err(GpuError::Device {
                adapter: self.info.name.clone(),
                message: "it cannot tell when a kernel begins and ends".into(),
            });
        }
        *self.times.lock() = Some(HashMap::new());
        Ok(())
    }

    /// The time of each kernel since [`Gpu::time_kernels`], the longest first.
    pub fn kernel_times(&self) -> Vec<KernelTime> {
        let period = f64::from(self.queue.get_timestamp_period()) * 1e-9;
        let times = self.times.lock();
        let mut times: Vec<_> = times
            .iter()
            .flatten()
            .map(|(kernel, &(dispatches, ticks))| KernelTime {
                kernel: Arc::clone(kernel),
                dispatches,
                seconds: ticks as f64 * period,
            })
            .collect();
        times.sort_by(|a, b| b.seconds.total_cmp(&a.seconds).then_with(|| a.kernel.cmp(&b.kernel)));
        times
    }
}

impl Times {
    fn lock(&self) -> MutexGuard<'_, Option<Sums>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Where the timestamps of a recording go, if kernels are timed.
    pub(super) fn stamps(&self) -> Option<Stamps> {
        self.lock().is_some().then(|| Stamps { sets: Vec::new(), kernels: Vec::new() })
    }
}

impl Stamps {
    /// Runs `dispatch` between two timestamps.
    pub(super) fn around(
        &mut self,
        device: &wgpu::Device,
        pass: &mut wgpu::ComputePass<'_>,
        kernel: &Arc<str>,
        dispatch: impl FnOnce(&mut wgpu::ComputePass<'_>),
    ) {
        let at = 2 * self.kernels.len() as u32 % SET;
        if at == 0 {
            let kind = wgpu::QueryType::Timestamp;
            self.sets.push(device.create_query_set(&wgpu::QuerySetDescriptor { label: None, ty: kind, count: SET }));
        }
        self.kernels.push(Arc::clone(kernel));
        let stamp = |pass: &mut wgpu::ComputePass<'_>, at: u32| {
            if let Some(set) = self.sets.last() {
                pass.write_timestamp(set, at);
            }
        };
        stamp(pass, at);
        dispatch(pass);
        stamp(pass, at + 1);
    }

    /// Records that the timestamps are read, into a buffer for each set.
    pub(super) fn resolve(&self, device: &wgpu::Device, encoder: &mut wgpu::CommandEncoder) -> Vec<wgpu::Buffer> {
        let sets = self.sets.iter().enumerate();
        sets.map(|(i, set)| {
            let count = (2 * self.kernels.len() as u32 - i as u32 * SET).min(SET);
            let buffer = |usage| {
                let size = u64::from(count) * 8;
                device.create_buffer(&wgpu::BufferDescriptor {
                    label: Some("timestamps"),
                    size,
                    usage,
                    mapped_at_creation: false,
                })
            };
            let resolved = buffer(wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC);
            let copy = buffer(wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST);
            encoder.resolve_query_set(set, 0..count, &resolved, 0);
            encoder.copy_buffer_to_buffer(&resolved, 0, &copy, 0, copy.size());
            copy
        })
        .collect()
    }

    /// Waits for the submission and adds its times to the sums. What cannot be read is not counted: the failure is told at the next
    /// [`Gpu::wait`].
    pub(super) fn count(self, gpu: &Gpu, submission: &Submission, buffers: &[wgpu::Buffer]) {
        let mut stamps: Vec<u64> = Vec::with_capacity(2 * self.kernels.len());
        for buffer in buffers {
            let _ = gpu.read_mapped(buffer, submission, "reading timestamps", |bytes| {
                stamps.extend(bytes.chunks_exact(8).map(bytemuck::pod_read_unaligned::<u64>));
            });
        }
        if let Some(times) = gpu.times.lock().as_mut() {
            for (kernel, pair) in self.kernels.iter().zip(stamps.chunks_exact(2)) {
                let (dispatches, ticks) = times.entry(Arc::clone(kernel)).or_default();
                *dispatches += 1;
                *ticks += pair[1].saturating_sub(pair[0]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::AdapterChoice;

    #[test]
    fn each_dispatch_of_a_kernel_is_timed() {
        let gpu = Gpu::open(&AdapterChoice::default()).expect("an adapter");
        let text = "@group(0) @binding(0) var<storage, read_write> sums: array<u32>;
            @compute @workgroup_size(1) fn main(@builtin(workgroup_id) group: vec3u) {
                for (var i = 0u; i < 1000u; i++) { sums[group.x] = sums[group.x] + i; }
            }";
        let [quick, slow] = ["quick", "slow"].map(|label| gpu.kernel(label, &[text]));
        let sums = gpu.storage("sums", 4096).expect("room");
        let run = |times: u32| {
            let mut commands = gpu.commands();
            for _ in 0..times {
                commands.dispatch(&quick, &[&sums], 1);
            }
            commands.dispatch(&slow, &[&sums], 1000);
            commands.submit();
        };
        run(1);
        assert_eq!(gpu.kernel_times(), [], "before timing began");
        gpu.time_kernels().expect("timestamps");
        // More than one set of timestamps holds.
        run(SET / 2);
        run(2);
        let times = gpu.kernel_times();
        let counts: Vec<_> = times.iter().map(|time| (&*time.kernel, time.dispatches)).collect();
        assert!(counts.contains(&("quick", u64::from(SET / 2) + 2)) && counts.contains(&("slow", 2)), "{counts:?}");
        let mean = |name: &str| {
            let time = times.iter().find(|time| &*time.kernel == name).expect("a kernel");
            time.seconds / time.dispatches as f64
        };
        assert!(mean("quick") > 0.0 && mean("slow") > mean("quick") && mean("slow") < 60.0, "{times:?}");
    }
}
